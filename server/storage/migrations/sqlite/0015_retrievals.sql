-- Series that are fetched from a DICOMweb node, or were.
CREATE TABLE retrievals (
    id           TEXT    NOT NULL PRIMARY KEY,
    node         TEXT    NOT NULL,
    study_uid    TEXT    NOT NULL,
    series_uid   TEXT    NOT NULL,
    state        TEXT    NOT NULL CHECK (state IN ('queued', 'running', 'done', 'failed')),
    reason       TEXT,    -- JSON, when failed
    received     INTEGER NOT NULL DEFAULT 0,
    expected     INTEGER, -- how many the node says there are
    attempts     INTEGER NOT NULL DEFAULT 0,
    created_at   INTEGER NOT NULL,
    available_at INTEGER NOT NULL,
    fence        INTEGER NOT NULL DEFAULT 0,
    lease_until  INTEGER
) STRICT, WITHOUT ROWID;

CREATE INDEX retrievals_by_age ON retrievals (created_at, id);
