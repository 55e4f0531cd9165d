-- The column is that of SQLite (../sqlite), where it is explained.
ALTER TABLE cases ADD COLUMN voxels TEXT COLLATE "C";

CREATE INDEX cases_by_voxels ON cases (voxels);
