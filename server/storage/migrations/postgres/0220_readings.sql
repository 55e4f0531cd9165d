-- The comments are in the migration for SQLite.
CREATE TABLE readings (
    case_id    TEXT COLLATE "C" NOT NULL REFERENCES cases (id) ON DELETE CASCADE,
    reader     TEXT COLLATE "C" NOT NULL,
    version    BIGINT           NOT NULL,
    document   TEXT             NOT NULL,
    digest     TEXT COLLATE "C" NOT NULL,
    changed_at BIGINT           NOT NULL,
    signed_at  BIGINT,
    PRIMARY KEY (case_id, reader, version)
);
