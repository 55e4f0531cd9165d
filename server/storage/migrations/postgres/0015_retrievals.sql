-- Series that are fetched from a DICOMweb node, or were.
CREATE TABLE retrievals (
    id           TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    node         TEXT COLLATE "C" NOT NULL,
    study_uid    TEXT COLLATE "C" NOT NULL,
    series_uid   TEXT COLLATE "C" NOT NULL,
    state        TEXT COLLATE "C" NOT NULL CHECK (state IN ('queued', 'running', 'done', 'failed')),
    reason       TEXT,    -- JSON, when failed
    received     BIGINT NOT NULL DEFAULT 0,
    expected     BIGINT, -- how many the node says there are
    attempts     BIGINT NOT NULL DEFAULT 0,
    created_at   BIGINT NOT NULL,
    available_at BIGINT NOT NULL,
    fence        BIGINT NOT NULL DEFAULT 0,
    lease_until  BIGINT
);

CREATE INDEX retrievals_by_age ON retrievals (created_at, id);
