-- Version 0.1.0. Numbers below 100 belonged to stores that were written before it, which are refused. From here on each
-- change of the tables is a further file.
--
-- Times are microseconds since 1970-01-01T00:00Z. Digests are 64 hexadecimal digits. The tables are those of SQLite
-- (../sqlite), where their columns are explained.

-- Which store this is: the object `store-id` has the same id. `complete` says that the pair was seen to be whole once.
CREATE TABLE store (
    one      INTEGER NOT NULL PRIMARY KEY CHECK (one = 1),
    id       TEXT    NOT NULL,
    complete BOOLEAN NOT NULL DEFAULT FALSE
);

CREATE TABLE cases (
    id                TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    closing_radius_mm DOUBLE PRECISION NOT NULL,
    parameters        TEXT             NOT NULL DEFAULT '{}',
    name              TEXT,
    state             TEXT             NOT NULL CHECK (state IN ('queued', 'ready', 'failed')),
    failure           TEXT,   -- JSON, when failed
    facts             TEXT,   -- JSON, when ready
    facts_digest      TEXT,   -- BLAKE3 of `facts`
    voxels            TEXT COLLATE "C",
    created_at        BIGINT           NOT NULL,
    uploaded_at       BIGINT,
    kept              BOOLEAN          NOT NULL DEFAULT FALSE,
    previous          TEXT COLLATE "C" REFERENCES cases (id),
    closed            BIGINT           NOT NULL DEFAULT 0, -- why it is closed: 1 rejected, 2 corrected; see `made_of`
    places            BIGINT,
    trashed           BOOLEAN          NOT NULL DEFAULT FALSE
);

CREATE INDEX cases_by_age ON cases (created_at, id);
CREATE INDEX cases_by_voxels ON cases (voxels);
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
    id           TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    kind         TEXT COLLATE "C" NOT NULL,
    key          TEXT COLLATE "C" NOT NULL,
    case_id      TEXT COLLATE "C" REFERENCES cases (id) ON DELETE CASCADE,
    needs_ready  BOOLEAN          NOT NULL,
    payload      TEXT             NOT NULL,
    client       TEXT COLLATE "C" NOT NULL DEFAULT '',
    state        TEXT COLLATE "C" NOT NULL CHECK (state IN ('queued', 'running', 'done', 'failed')),
    progress     TEXT,
    failure      TEXT,
    attempts     BIGINT           NOT NULL DEFAULT 0,
    created_at   BIGINT           NOT NULL,
    available_at BIGINT           NOT NULL,
    ended_at     BIGINT,
    fence        BIGINT           NOT NULL DEFAULT 0,
    lease_until  BIGINT
);

CREATE UNIQUE INDEX jobs_open ON jobs (kind, key) WHERE state IN ('queued', 'running');
CREATE INDEX jobs_to_do ON jobs (kind, created_at, id) WHERE state IN ('queued', 'running');
CREATE INDEX jobs_by_client ON jobs (kind, client);
CREATE INDEX jobs_by_key ON jobs (key, created_at);
CREATE INDEX jobs_by_case ON jobs (case_id);
CREATE INDEX jobs_by_end ON jobs (ended_at) WHERE state IN ('done', 'failed');

CREATE TABLE fence (value BIGINT NOT NULL);
INSERT INTO fence (value) VALUES (0);

CREATE TABLE expiry (
    seen_at          BIGINT,
    day              BIGINT NOT NULL,
    removed          BIGINT NOT NULL,
    received_seen_at BIGINT
);
INSERT INTO expiry (day, removed) VALUES (0, 0);

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
    IF NEW.case_id IS NOT NULL THEN
        PERFORM pg_notify('isocortex', 'changed ' || NEW.case_id);
    END IF;
    IF NEW.state = 'queued' THEN
        PERFORM pg_notify('isocortex', 'queued');
    END IF;
    RETURN NULL;
END $$;

CREATE TRIGGER announce AFTER INSERT OR UPDATE ON jobs
    FOR EACH ROW EXECUTE FUNCTION announce_job();

CREATE TABLE layers (
    case_id      TEXT COLLATE "C" NOT NULL REFERENCES cases (id) ON DELETE CASCADE,
    id           TEXT COLLATE "C" NOT NULL,
    name         TEXT             NOT NULL,
    place        BIGINT           NOT NULL,
    parameters   TEXT             NOT NULL,
    state        TEXT             NOT NULL CHECK (state IN ('queued', 'ready', 'failed')),
    failure      TEXT,
    facts        TEXT,
    facts_digest TEXT,
    created_at   BIGINT           NOT NULL,
    series_uid   TEXT COLLATE "C",   -- of the images that it is made of
    closed       BIGINT           NOT NULL DEFAULT 0, -- as of `cases`
    places       BIGINT,
    PRIMARY KEY (case_id, id),
    UNIQUE (case_id, name)
);

CREATE INDEX layers_by_series ON layers (series_uid);

CREATE TABLE layer_objects (
    case_id  TEXT COLLATE "C" NOT NULL,
    layer_id TEXT COLLATE "C" NOT NULL,
    kind     TEXT COLLATE "C" NOT NULL,
    digest   TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (case_id, layer_id, kind),
    FOREIGN KEY (case_id, layer_id) REFERENCES layers (case_id, id) ON DELETE CASCADE
);

CREATE INDEX layer_objects_by_name ON layer_objects (kind, digest);

-- A change of a layer is one of its case.
CREATE FUNCTION announce_layer() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    IF TG_OP = 'DELETE' THEN
        PERFORM pg_notify('isocortex', 'changed ' || OLD.case_id);
        RETURN NULL;
    END IF;
    PERFORM pg_notify('isocortex', 'changed ' || NEW.case_id);
    RETURN NULL;
END $$;

CREATE TRIGGER announce AFTER INSERT OR UPDATE OR DELETE ON layers
    FOR EACH ROW EXECUTE FUNCTION announce_layer();

CREATE TABLE findings (
    case_id    TEXT COLLATE "C" NOT NULL PRIMARY KEY REFERENCES cases (id) ON DELETE CASCADE,
    document   TEXT             NOT NULL,
    digest     TEXT COLLATE "C" NOT NULL,
    changed_at BIGINT           NOT NULL,
    kept       BIGINT           NOT NULL DEFAULT 0,
    readers    TEXT             NOT NULL DEFAULT ''
);

-- Which images a case, a layer or the layers of a result were made of, whoever brought them.
CREATE TABLE made_of (
    case_id          TEXT COLLATE "C" NOT NULL REFERENCES cases (id) ON DELETE CASCADE,
    layer_id         TEXT COLLATE "C" NOT NULL DEFAULT '', -- empty for those of a case or a result
    result_id        TEXT COLLATE "C" NOT NULL DEFAULT '', -- empty for those of a case or a layer
    sop_instance_uid TEXT COLLATE "C" NOT NULL,
    fingerprint      TEXT COLLATE "C" NOT NULL,
    times            BIGINT  NOT NULL, -- how often it had been sent when it was read
    PRIMARY KEY (case_id, layer_id, result_id, sop_instance_uid)
);

CREATE INDEX made_of_by_image ON made_of (sop_instance_uid);

-- The series that cases were made of, for requests that name one.
CREATE TABLE case_series (
    case_id          TEXT COLLATE "C" NOT NULL PRIMARY KEY REFERENCES cases (id) ON DELETE CASCADE,
    study_uid        TEXT COLLATE "C" NOT NULL,
    series_uid       TEXT COLLATE "C" NOT NULL,
    accession_number TEXT,
    patient          TEXT COLLATE "C" -- a keyed digest of the Patient ID
);

CREATE INDEX case_series_by_study ON case_series (study_uid, series_uid);
CREATE INDEX case_series_by_series ON case_series (series_uid);
CREATE INDEX case_series_by_patient ON case_series (patient);
CREATE INDEX case_series_by_accession_number ON case_series (accession_number);
