-- Version 0.1.0. Numbers below 100 belonged to stores that were written before it, which are refused. From here on each
-- change of the tables is a further file.
--
-- Times are microseconds since 1970-01-01T00:00Z. Digests are 64 hexadecimal digits.

-- Which store this is: the object `store-id` has the same id. `complete` says that the pair was seen to be whole once.
CREATE TABLE store (
    one      INTEGER NOT NULL PRIMARY KEY CHECK (one = 1),
    id       TEXT    NOT NULL,
    complete INTEGER NOT NULL DEFAULT 0
) STRICT;

CREATE TABLE cases (
    id                TEXT    NOT NULL PRIMARY KEY,
    closing_radius_mm REAL    NOT NULL,
    parameters        TEXT    NOT NULL DEFAULT '{}', -- those without a column of their own: JSON, in which what is missing has its default
    name              TEXT,
    state             TEXT    NOT NULL CHECK (state IN ('queued', 'ready', 'failed')), -- its job tells whether it is being prepared
    failure           TEXT,   -- JSON, when failed
    facts             TEXT,   -- JSON, when ready
    facts_digest      TEXT,   -- BLAKE3 of `facts`: they hold the affine, and a digit that flips on the disk would move every coordinate
    voxels            TEXT,   -- `voxels.values` of the facts, to find cases with the same voxels and another header
    created_at        INTEGER NOT NULL,
    uploaded_at       INTEGER, -- the latest upload of the same input, from which the age counts; NULL if there was only one
    kept              INTEGER NOT NULL DEFAULT 0, -- whether it is never removed because of its age
    previous          TEXT    REFERENCES cases (id), -- the case of which this is a version, with another mask or other parameters
    closed            INTEGER NOT NULL DEFAULT 0, -- why it is closed: 1 rejected, 2 corrected; see `made_of`
    places            INTEGER, -- how many places of its maps stand out; NULL until they are computed or read
    trashed           INTEGER NOT NULL DEFAULT 0 -- whether lists leave it out
) STRICT;

CREATE INDEX cases_by_age ON cases (created_at, id);
CREATE INDEX cases_by_voxels ON cases (voxels);
CREATE INDEX cases_by_previous ON cases (previous, created_at, id);

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

-- Work that one process at a time does: a case to be prepared, a layer, maps, a series to be read, and what others register. The
-- row stays some days after its end.
CREATE TABLE jobs (
    id           TEXT    NOT NULL PRIMARY KEY,
    kind         TEXT    NOT NULL,
    key          TEXT    NOT NULL,   -- what it is about
    case_id      TEXT    REFERENCES cases (id) ON DELETE CASCADE,
    needs_ready  INTEGER NOT NULL,   -- whether it waits until its case is ready
    payload      TEXT    NOT NULL,   -- JSON, for whoever does it
    client       TEXT    NOT NULL DEFAULT '',   -- a digest of who asked for it; clients take turns
    state        TEXT    NOT NULL CHECK (state IN ('queued', 'running', 'done', 'failed')),
    progress     TEXT,               -- JSON, of the latest attempt
    failure      TEXT,               -- JSON: why it failed, or why the latest attempt did
    attempts     INTEGER NOT NULL DEFAULT 0,
    created_at   INTEGER NOT NULL,
    available_at INTEGER NOT NULL,
    ended_at     INTEGER,
    fence        INTEGER NOT NULL DEFAULT 0,
    lease_until  INTEGER
) STRICT;

-- One job for each thing to be done.
CREATE UNIQUE INDEX jobs_open ON jobs (kind, key) WHERE state IN ('queued', 'running');
CREATE INDEX jobs_to_do ON jobs (kind, created_at, id) WHERE state IN ('queued', 'running');
CREATE INDEX jobs_by_client ON jobs (kind, client);
CREATE INDEX jobs_by_key ON jobs (key, created_at);
CREATE INDEX jobs_by_case ON jobs (case_id);
CREATE INDEX jobs_by_end ON jobs (ended_at) WHERE state IN ('done', 'failed');

-- One number, handed out with each lease and never twice.
CREATE TABLE fence (value INTEGER NOT NULL) STRICT;
INSERT INTO fence (value) VALUES (0);

-- One row: what the removal of old cases knows of the clock, and how many went on which day.
CREATE TABLE expiry (
    seen_at          INTEGER, -- the last time that was believed; NULL at first
    day              INTEGER NOT NULL, -- since 1970
    removed          INTEGER NOT NULL, -- on that day
    received_seen_at INTEGER  -- as `seen_at`, of the removal of what a PACS has sent, which is kept for another time than cases
) STRICT;
INSERT INTO expiry (day, removed) VALUES (0, 0);

-- Objects that nobody needs and that are being removed. While a tombstone is there the object cannot be pinned, so that nobody
-- refers to it; if whoever removes it is killed, another one takes over after `lease_until`.
CREATE TABLE tombstones (
    kind        TEXT    NOT NULL,
    digest      TEXT    NOT NULL,
    holder      TEXT    NOT NULL,
    lease_until INTEGER NOT NULL,
    PRIMARY KEY (kind, digest)
) STRICT, WITHOUT ROWID;

-- Further volumes of the head of a case. A version of a case has rows of its own for the same layers.
CREATE TABLE layers (
    case_id      TEXT    NOT NULL REFERENCES cases (id) ON DELETE CASCADE,
    id           TEXT    NOT NULL,
    name         TEXT    NOT NULL,
    place        INTEGER NOT NULL,   -- in the list of the layers of the case
    parameters   TEXT    NOT NULL,   -- JSON
    state        TEXT    NOT NULL CHECK (state IN ('queued', 'ready', 'failed')), -- as of `cases`
    failure      TEXT,   -- JSON, when failed
    facts        TEXT,   -- JSON, when ready; when queued again, those before, whose placement stays
    facts_digest TEXT,   -- BLAKE3 of `facts`
    created_at   INTEGER NOT NULL,
    series_uid   TEXT,   -- of the images that it is made of
    closed       INTEGER NOT NULL DEFAULT 0, -- as of `cases`
    places       INTEGER, -- as of `cases`, of its own map
    PRIMARY KEY (case_id, id),
    UNIQUE (case_id, name)
) STRICT;

CREATE INDEX layers_by_series ON layers (series_uid);

-- Which objects a layer needs. Several layers may need the same one.
CREATE TABLE layer_objects (
    case_id  TEXT NOT NULL,
    layer_id TEXT NOT NULL,
    kind     TEXT NOT NULL,
    digest   TEXT NOT NULL,
    PRIMARY KEY (case_id, layer_id, kind),
    FOREIGN KEY (case_id, layer_id) REFERENCES layers (case_id, id) ON DELETE CASCADE
) STRICT, WITHOUT ROWID;

CREATE INDEX layer_objects_by_name ON layer_objects (kind, digest);

-- What readers have marked and written: the one part of a case that changes and is derived from nothing. A version of a case
-- begins with a copy.
CREATE TABLE findings (
    case_id    TEXT    NOT NULL PRIMARY KEY REFERENCES cases (id) ON DELETE CASCADE,
    document   TEXT    NOT NULL, -- JSON
    digest     TEXT    NOT NULL, -- BLAKE3 of `document`, which is also its version
    changed_at INTEGER NOT NULL,
    kept       INTEGER NOT NULL DEFAULT 0, -- how many of `document` are not dismissed
    readers    TEXT    NOT NULL DEFAULT '' -- the names of their authors, a line each
) STRICT;

-- Which images a case, a layer or the layers of a result were made of, whoever brought them.
CREATE TABLE made_of (
    case_id          TEXT   NOT NULL REFERENCES cases (id) ON DELETE CASCADE,
    layer_id         TEXT   NOT NULL DEFAULT '', -- empty for those of a case or a result
    result_id        TEXT   NOT NULL DEFAULT '', -- empty for those of a case or a layer
    sop_instance_uid TEXT   NOT NULL,
    fingerprint      TEXT   NOT NULL,
    times            INTEGER NOT NULL, -- how often it had been sent when it was read
    PRIMARY KEY (case_id, layer_id, result_id, sop_instance_uid)
) STRICT, WITHOUT ROWID;

CREATE INDEX made_of_by_image ON made_of (sop_instance_uid);

-- The series that cases were made of, for requests that name one.
CREATE TABLE case_series (
    case_id          TEXT NOT NULL PRIMARY KEY REFERENCES cases (id) ON DELETE CASCADE,
    study_uid        TEXT NOT NULL,
    series_uid       TEXT NOT NULL,
    accession_number TEXT,
    patient          TEXT -- a keyed digest of the Patient ID
) STRICT, WITHOUT ROWID;

CREATE INDEX case_series_by_study ON case_series (study_uid, series_uid);
CREATE INDEX case_series_by_series ON case_series (series_uid);
CREATE INDEX case_series_by_patient ON case_series (patient);
CREATE INDEX case_series_by_accession_number ON case_series (accession_number);
