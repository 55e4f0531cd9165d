-- Series that somebody takes although they were refused, and what lists call them.

ALTER TABLE arrivals ADD COLUMN label TEXT; -- from the series, never from the patient; NULL in a store without identities
ALTER TABLE arrivals ADD COLUMN taken TEXT; -- JSON, when somebody took it
ALTER TABLE arrivals ADD COLUMN refused TEXT; -- JSON: the reason for which it was refused before
