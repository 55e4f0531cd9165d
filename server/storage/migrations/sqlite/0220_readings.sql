-- Conclusions of named readers, each with the findings that it rests on. A signed version is never written again; a correction is
-- the next one. Only the last version of a reader may be open.
CREATE TABLE readings (
    case_id    TEXT    NOT NULL REFERENCES cases (id) ON DELETE CASCADE,
    reader     TEXT    NOT NULL,
    version    INTEGER NOT NULL, -- from 1
    document   TEXT    NOT NULL, -- JSON
    digest     TEXT    NOT NULL, -- BLAKE3 of `document`
    changed_at INTEGER NOT NULL,
    signed_at  INTEGER,          -- NULL while it is open
    PRIMARY KEY (case_id, reader, version)
) STRICT;
