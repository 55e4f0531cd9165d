-- `voxels.values` of the facts, to find cases with the same voxels and another header. Cases of earlier versions have none.
ALTER TABLE cases ADD COLUMN voxels TEXT;

CREATE INDEX cases_by_voxels ON cases (voxels);
