-- What the list of cases states and is sorted by: see `sqlite/0120_worklist.sql`.

ALTER TABLE cases ADD COLUMN places BIGINT;
ALTER TABLE cases ADD COLUMN trashed BOOLEAN NOT NULL DEFAULT FALSE;
ALTER TABLE layers ADD COLUMN places BIGINT;

ALTER TABLE findings ADD COLUMN kept BIGINT NOT NULL DEFAULT 0;
ALTER TABLE findings ADD COLUMN readers TEXT NOT NULL DEFAULT '';

UPDATE findings
SET kept = (SELECT count(*) FROM jsonb_array_elements(document::jsonb) AS one WHERE coalesce(one ->> 'is_dismissed', 'false') <> 'true'),
    readers = coalesce((SELECT string_agg(author, chr(10))
                        FROM (SELECT DISTINCT one ->> 'author' AS author FROM jsonb_array_elements(document::jsonb) AS one) AS authors
                        WHERE author <> ''), '');
