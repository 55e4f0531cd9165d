-- Series that come from a PACS, until they are cases and for some days after. UIDs and accession numbers are here because
-- requests name series by them; names and birth dates are not.
CREATE TABLE arrivals (
    id               TEXT COLLATE "C" NOT NULL PRIMARY KEY,
    study_uid        TEXT COLLATE "C" NOT NULL,
    series_uid       TEXT COLLATE "C" NOT NULL,
    accession_number TEXT,
    source           TEXT COLLATE "C" NOT NULL CHECK (source IN ('stow', 'c-store', 'retrieval')),
    state            TEXT COLLATE "C" NOT NULL CHECK (state IN ('receiving', 'case', 'nothing')),
    reason           TEXT,    -- JSON, when it became nothing
    case_id          TEXT COLLATE "C" REFERENCES cases (id) ON DELETE SET NULL,
    instances        BIGINT NOT NULL DEFAULT 0,
    expected         BIGINT, -- how many the sender says there are
    first_at         BIGINT NOT NULL,
    last_at          BIGINT NOT NULL,
    available_at     BIGINT NOT NULL,
    fence            BIGINT NOT NULL DEFAULT 0,
    lease_until      BIGINT,
    UNIQUE (study_uid, series_uid)
);

CREATE INDEX arrivals_by_age ON arrivals (first_at, id);
CREATE INDEX arrivals_by_case ON arrivals (case_id);
CREATE INDEX arrivals_by_accession_number ON arrivals (accession_number);

-- Their images: objects of the kind `instance`.
CREATE TABLE arrival_instances (
    arrival_id       TEXT COLLATE "C" NOT NULL REFERENCES arrivals (id) ON DELETE CASCADE,
    sop_instance_uid TEXT COLLATE "C" NOT NULL,
    digest           TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (arrival_id, sop_instance_uid)
);

CREATE INDEX arrival_instances_by_digest ON arrival_instances (digest);

-- The series that cases were made of, for requests that name one.
CREATE TABLE case_series (
    case_id          TEXT COLLATE "C" NOT NULL PRIMARY KEY REFERENCES cases (id) ON DELETE CASCADE,
    study_uid        TEXT COLLATE "C" NOT NULL,
    series_uid       TEXT COLLATE "C" NOT NULL,
    accession_number TEXT
);

CREATE INDEX case_series_by_study ON case_series (study_uid, series_uid);
CREATE INDEX case_series_by_accession_number ON case_series (accession_number);
