-- Objects of a series that were refused, as often as they came, and why the last of them was.
ALTER TABLE arrivals ADD COLUMN refused_objects BIGINT NOT NULL DEFAULT 0;
ALTER TABLE arrivals ADD COLUMN last_refusal TEXT;
