-- What the list of cases states and is sorted by. The number follows those of the tables of a PACS, so that an earlier program
-- refuses the store.

ALTER TABLE cases ADD COLUMN places INTEGER; -- how many places of its maps stand out; NULL until they are computed or read
ALTER TABLE cases ADD COLUMN trashed INTEGER NOT NULL DEFAULT 0; -- whether lists leave it out
ALTER TABLE layers ADD COLUMN places INTEGER; -- as of `cases`, of its own map

-- Of `document`: how many findings are not dismissed, and the names of the authors, a line each.
ALTER TABLE findings ADD COLUMN kept INTEGER NOT NULL DEFAULT 0;
ALTER TABLE findings ADD COLUMN readers TEXT NOT NULL DEFAULT '';

UPDATE findings
SET kept = (SELECT count(*) FROM json_each(document) WHERE NOT coalesce(json_extract(value, '$.is_dismissed'), 0)),
    readers = coalesce((SELECT group_concat(author, char(10))
                        FROM (SELECT DISTINCT json_extract(value, '$.author') AS author FROM json_each(document))
                        WHERE author <> ''), '')
WHERE json_valid(document);
