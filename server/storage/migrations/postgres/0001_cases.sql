-- Times are microseconds since 1970-01-01T00:00Z. Digests are 64 hexadecimal digits. The tables are those of SQLite
-- (../sqlite), where their columns are explained.

CREATE TABLE cases (
    id                TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    closing_radius_mm DOUBLE PRECISION NOT NULL,
    parameters        TEXT             NOT NULL DEFAULT '{}',
    name              TEXT,
    state             TEXT             NOT NULL CHECK (state IN ('queued', 'preparing', 'ready', 'failed')),
    failure           TEXT,   -- JSON, when failed
    facts             TEXT,   -- JSON, when ready
    facts_digest      TEXT,   -- BLAKE3 of `facts`
    created_at        BIGINT           NOT NULL,
    previous          TEXT COLLATE "C" REFERENCES cases (id)
);

CREATE INDEX cases_by_age ON cases (created_at, id);
CREATE INDEX cases_by_previous ON cases (previous, created_at, id);

CREATE TABLE case_objects (
    case_id TEXT COLLATE "C" NOT NULL REFERENCES cases (id) ON DELETE CASCADE,
    kind    TEXT COLLATE "C" NOT NULL,
    digest  TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (case_id, kind)
);

CREATE INDEX case_objects_by_name ON case_objects (kind, digest);

CREATE TABLE pins (
    kind       TEXT COLLATE "C" NOT NULL,
    digest     TEXT COLLATE "C" NOT NULL,
    holder     TEXT COLLATE "C" NOT NULL,
    expires_at BIGINT           NOT NULL,
    PRIMARY KEY (kind, digest, holder)
);

CREATE INDEX pins_by_expiry ON pins (expires_at);

CREATE TABLE tombstones (
    kind        TEXT COLLATE "C" NOT NULL,
    digest      TEXT COLLATE "C" NOT NULL,
    holder      TEXT COLLATE "C" NOT NULL,
    lease_until BIGINT           NOT NULL,
    PRIMARY KEY (kind, digest)
);

CREATE TABLE jobs (
    case_id      TEXT COLLATE "C" NOT NULL PRIMARY KEY REFERENCES cases (id) ON DELETE CASCADE,
    queued_at    BIGINT           NOT NULL,
    available_at BIGINT           NOT NULL,
    attempts     BIGINT           NOT NULL DEFAULT 0,
    fence        BIGINT           NOT NULL DEFAULT 0,
    lease_until  BIGINT,
    stage        TEXT,
    fraction     REAL
);

CREATE INDEX jobs_by_age ON jobs (queued_at, case_id);

CREATE TABLE rebuilds (
    case_id     TEXT COLLATE "C" NOT NULL PRIMARY KEY REFERENCES cases (id) ON DELETE CASCADE,
    holder      TEXT COLLATE "C" NOT NULL,
    lease_until BIGINT           NOT NULL
);

CREATE TABLE fence (value BIGINT NOT NULL);
INSERT INTO fence (value) VALUES (0);

-- Every change of a case is announced to all processes when it is committed: `changed ID`, `deleted ID`, and `queued` when a
-- worker may find a job. Who misses an announcement finds the change when it looks the next time.
CREATE FUNCTION announce_case() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    IF TG_OP = 'DELETE' THEN
        PERFORM pg_notify('isocortex', 'deleted ' || OLD.id);
    ELSE
        PERFORM pg_notify('isocortex', 'changed ' || NEW.id);
    END IF;
    RETURN NULL;
END $$;

CREATE TRIGGER announce AFTER INSERT OR UPDATE OR DELETE ON cases
    FOR EACH ROW EXECUTE FUNCTION announce_case();

CREATE FUNCTION announce_job() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    PERFORM pg_notify('isocortex', 'changed ' || NEW.case_id);
    IF NEW.lease_until IS NULL THEN
        PERFORM pg_notify('isocortex', 'queued');
    END IF;
    RETURN NULL;
END $$;

CREATE TRIGGER announce AFTER INSERT OR UPDATE ON jobs
    FOR EACH ROW EXECUTE FUNCTION announce_job();
