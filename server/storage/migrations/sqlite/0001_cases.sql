-- Times are microseconds since 1970-01-01T00:00Z. Digests are 64 hexadecimal digits.

CREATE TABLE cases (
    id                TEXT    NOT NULL PRIMARY KEY,
    closing_radius_mm REAL    NOT NULL,
    name              TEXT,
    state             TEXT    NOT NULL CHECK (state IN ('queued', 'preparing', 'ready', 'failed')),
    failure           TEXT,   -- JSON, when failed
    facts             TEXT,   -- JSON, when ready
    created_at        INTEGER NOT NULL
) STRICT;

CREATE INDEX cases_by_age ON cases (created_at, id);

-- Which objects a case needs. Two cases may need the same one.
CREATE TABLE case_objects (
    case_id TEXT NOT NULL REFERENCES cases (id) ON DELETE CASCADE,
    kind    TEXT NOT NULL,
    digest  TEXT NOT NULL,
    PRIMARY KEY (case_id, kind)
) STRICT, WITHOUT ROWID;

CREATE INDEX case_objects_by_name ON case_objects (kind, digest);

-- Objects that must not be removed yet though no case needs them: they are being written. Every object is pinned
-- before it is written, and every object that a case ceases to need is left with an expired pin; so the expired
-- pins name all that may have to be removed.
CREATE TABLE pins (
    kind       TEXT    NOT NULL,
    digest     TEXT    NOT NULL,
    holder     TEXT    NOT NULL,
    expires_at INTEGER NOT NULL,
    PRIMARY KEY (kind, digest, holder)
) STRICT, WITHOUT ROWID;

CREATE INDEX pins_by_expiry ON pins (expires_at);

-- Preparations to be done. The row goes when the case is ready or failed.
CREATE TABLE jobs (
    case_id      TEXT    NOT NULL PRIMARY KEY REFERENCES cases (id) ON DELETE CASCADE,
    queued_at    INTEGER NOT NULL,
    available_at INTEGER NOT NULL,
    attempts     INTEGER NOT NULL DEFAULT 0,
    fence        INTEGER NOT NULL DEFAULT 0,
    lease_until  INTEGER,
    stage        TEXT,
    fraction     REAL
) STRICT;

CREATE INDEX jobs_by_age ON jobs (queued_at);

-- One number, handed out with each lease and never twice.
CREATE TABLE fence (value INTEGER NOT NULL) STRICT;
INSERT INTO fence (value) VALUES (0);
