-- Further volumes of the head of a case. A version of a case has rows of its own for the same layers.
CREATE TABLE layers (
    case_id      TEXT    NOT NULL REFERENCES cases (id) ON DELETE CASCADE,
    id           TEXT    NOT NULL,
    name         TEXT    NOT NULL,
    place        INTEGER NOT NULL,   -- in the list of the layers of the case
    parameters   TEXT    NOT NULL,   -- JSON
    state        TEXT    NOT NULL CHECK (state IN ('queued', 'preparing', 'ready', 'failed')),
    failure      TEXT,   -- JSON, when failed
    facts        TEXT,   -- JSON, when ready; when queued again, those before, whose placement stays
    facts_digest TEXT,   -- BLAKE3 of `facts`
    created_at   INTEGER NOT NULL,
    -- The job: as in `jobs`. It is leased once the case is ready.
    available_at INTEGER NOT NULL,
    attempts     INTEGER NOT NULL DEFAULT 0,
    fence        INTEGER NOT NULL DEFAULT 0,
    lease_until  INTEGER,
    PRIMARY KEY (case_id, id),
    UNIQUE (case_id, name)
) STRICT;

CREATE INDEX layers_to_prepare ON layers (available_at) WHERE state IN ('queued', 'preparing');

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
