-- The comments are in the migration for SQLite.
CREATE TABLE preferences (
    user_name  TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    document   TEXT             NOT NULL,
    changed_at BIGINT           NOT NULL
);
