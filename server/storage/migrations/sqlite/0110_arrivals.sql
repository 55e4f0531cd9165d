-- Series that somebody takes although they were refused, what lists call them, and what was rejected.

ALTER TABLE arrivals ADD COLUMN label TEXT; -- from the series, never from the patient; NULL in a store without identities
ALTER TABLE arrivals ADD COLUMN taken TEXT; -- JSON, when somebody took it
ALTER TABLE arrivals ADD COLUMN refused TEXT; -- JSON: the reason for which it was refused before

-- Instances that a rejection note has withdrawn for good: images that are not received again, and results of ours.
CREATE TABLE rejections (
    sop_instance_uid TEXT NOT NULL PRIMARY KEY
) STRICT, WITHOUT ROWID;

-- An image that is known may come again under another study or series.
CREATE INDEX arrival_instances_by_uid ON arrival_instances (sop_instance_uid);
