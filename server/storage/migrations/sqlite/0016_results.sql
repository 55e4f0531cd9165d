-- Results that are sent to a node, or were. Each is an object of the kind `result`.
CREATE TABLE results (
    id                TEXT NOT NULL PRIMARY KEY,
    case_id           TEXT NOT NULL REFERENCES cases (id) ON DELETE CASCADE,
    node              TEXT NOT NULL,
    sop_instance_uid  TEXT NOT NULL,
    study_uid         TEXT NOT NULL,
    digest            TEXT NOT NULL,
    state             TEXT NOT NULL CHECK (state IN ('queued', 'running', 'done', 'failed')),
    reason            TEXT,    -- JSON, when failed
    attempts          INTEGER NOT NULL DEFAULT 0,
    created_at        INTEGER NOT NULL,
    available_at      INTEGER NOT NULL,
    fence             INTEGER NOT NULL DEFAULT 0,
    lease_until       INTEGER,
    UNIQUE (sop_instance_uid, node)
) STRICT, WITHOUT ROWID;

CREATE INDEX results_by_case ON results (case_id);
CREATE INDEX results_by_age ON results (created_at, id);
CREATE INDEX results_by_digest ON results (digest);
