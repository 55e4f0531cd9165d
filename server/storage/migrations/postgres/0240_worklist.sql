-- The comments are in the migration for SQLite.
ALTER TABLE cases ADD COLUMN label_key TEXT COLLATE "C";
ALTER TABLE cases ADD COLUMN mask      TEXT COLLATE "C";

CREATE INDEX cases_without_label_key ON cases (id) WHERE label_key IS NULL;
