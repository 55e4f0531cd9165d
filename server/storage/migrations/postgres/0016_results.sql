-- Results that are sent to a node, or were. Each is an object of the kind `result`.
CREATE TABLE results (
    id                TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    case_id           TEXT COLLATE "C" NOT NULL REFERENCES cases (id) ON DELETE CASCADE,
    node              TEXT COLLATE "C" NOT NULL,
    sop_instance_uid  TEXT COLLATE "C" NOT NULL,
    study_uid         TEXT COLLATE "C" NOT NULL,
    digest            TEXT COLLATE "C" NOT NULL,
    state             TEXT COLLATE "C" NOT NULL CHECK (state IN ('queued', 'running', 'done', 'failed')),
    reason            TEXT,    -- JSON, when failed
    attempts          BIGINT NOT NULL DEFAULT 0,
    created_at        BIGINT NOT NULL,
    available_at      BIGINT NOT NULL,
    fence             BIGINT NOT NULL DEFAULT 0,
    lease_until       BIGINT,
    UNIQUE (sop_instance_uid, node)
);

CREATE INDEX results_by_case ON results (case_id);
CREATE INDEX results_by_age ON results (created_at, id);
CREATE INDEX results_by_digest ON results (digest);
