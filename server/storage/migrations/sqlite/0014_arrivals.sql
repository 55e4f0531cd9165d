-- Series that come from a PACS, until they are cases and for some days after. UIDs and accession numbers are here because
-- requests name series by them; names and birth dates are not.
CREATE TABLE arrivals (
    id               TEXT    NOT NULL PRIMARY KEY,
    study_uid        TEXT    NOT NULL,
    series_uid       TEXT    NOT NULL,
    accession_number TEXT,
    source           TEXT    NOT NULL CHECK (source IN ('stow', 'c-store', 'retrieval')),
    state            TEXT    NOT NULL CHECK (state IN ('receiving', 'case', 'nothing')),
    reason           TEXT,    -- JSON, when it became nothing
    case_id          TEXT    REFERENCES cases (id) ON DELETE SET NULL,
    instances        INTEGER NOT NULL DEFAULT 0,
    expected         INTEGER, -- how many the sender says there are
    first_at         INTEGER NOT NULL,
    last_at          INTEGER NOT NULL,
    available_at     INTEGER NOT NULL,
    fence            INTEGER NOT NULL DEFAULT 0,
    lease_until      INTEGER,
    UNIQUE (study_uid, series_uid)
) STRICT, WITHOUT ROWID;

CREATE INDEX arrivals_by_age ON arrivals (first_at, id);
CREATE INDEX arrivals_by_case ON arrivals (case_id);
CREATE INDEX arrivals_by_accession_number ON arrivals (accession_number);

-- Their images: objects of the kind `instance`.
CREATE TABLE arrival_instances (
    arrival_id       TEXT NOT NULL REFERENCES arrivals (id) ON DELETE CASCADE,
    sop_instance_uid TEXT NOT NULL,
    digest           TEXT NOT NULL,
    PRIMARY KEY (arrival_id, sop_instance_uid)
) STRICT, WITHOUT ROWID;

CREATE INDEX arrival_instances_by_digest ON arrival_instances (digest);

-- The series that cases were made of, for requests that name one.
CREATE TABLE case_series (
    case_id          TEXT NOT NULL PRIMARY KEY REFERENCES cases (id) ON DELETE CASCADE,
    study_uid        TEXT NOT NULL,
    series_uid       TEXT NOT NULL,
    accession_number TEXT
) STRICT, WITHOUT ROWID;

CREATE INDEX case_series_by_study ON case_series (study_uid, series_uid);
CREATE INDEX case_series_by_accession_number ON case_series (accession_number);
