-- Parameters that have no column of their own: JSON, in which what is missing has its default.
ALTER TABLE cases ADD COLUMN parameters TEXT NOT NULL DEFAULT '{}';

-- The case of which this is a version, with another mask or other parameters.
ALTER TABLE cases ADD COLUMN previous TEXT REFERENCES cases (id);

CREATE INDEX cases_by_previous ON cases (previous, created_at, id);

-- The first version told less of a case. What it had prepared is prepared anew from the source.
INSERT INTO jobs (case_id, queued_at, available_at)
SELECT id, created_at, created_at FROM cases
WHERE state = 'ready' AND json_extract(facts, '$.quality') IS NULL;

UPDATE cases SET state = 'queued', facts = NULL
WHERE state = 'ready' AND json_extract(facts, '$.quality') IS NULL;
