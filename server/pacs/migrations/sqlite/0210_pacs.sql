-- The tables of the PACS, beside those of the store. What 0200_store.sql says of numbers, times and digests holds here too.

-- Series that come from a PACS, until they are cases and for some days after. UIDs and accession numbers are here because
-- requests name series by them; names and birth dates are not.
CREATE TABLE arrivals (
    id               TEXT    NOT NULL PRIMARY KEY,
    study_uid        TEXT    NOT NULL,
    series_uid       TEXT    NOT NULL,
    accession_number TEXT,
    source           TEXT    NOT NULL CHECK (source IN ('stow', 'c-store', 'retrieval')),
    label            TEXT,    -- from the series, never from the patient; NULL in a store without identities
    state            TEXT    NOT NULL CHECK (state IN ('receiving', 'case', 'layer', 'nothing')),
    reason           TEXT,    -- JSON, when it became nothing
    taken            TEXT,    -- JSON, when somebody took it although it was refused
    refused          TEXT,    -- JSON: the reason for which it was refused before
    -- The case that it is or of which it is a layer, until its images are corrected or rejected.
    case_id          TEXT    REFERENCES cases (id) ON DELETE SET NULL,
    instances        INTEGER NOT NULL DEFAULT 0,
    corrected        INTEGER NOT NULL DEFAULT 0, -- images that took the place of others with the same UID
    ignored          INTEGER NOT NULL DEFAULT 0, -- objects that were not kept
    refused_objects  INTEGER NOT NULL DEFAULT 0, -- as often as they came
    last_refusal     TEXT,    -- why the last of them was refused
    expected         INTEGER, -- how many the sender says there are
    first_at         INTEGER NOT NULL,
    last_at          INTEGER NOT NULL,
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
-- An image that is known may come again under another study or series.
CREATE INDEX arrival_instances_by_uid ON arrival_instances (sop_instance_uid);

-- Images as a PACS has sent them last, one for each SOP Instance UID. A row outlives its file and its series: it stays while something
-- is made of its image, and for a year.
CREATE TABLE images (
    sop_instance_uid TEXT   NOT NULL PRIMARY KEY,
    study_uid        TEXT   NOT NULL,
    series_uid       TEXT   NOT NULL,
    fingerprint      TEXT   NOT NULL, -- what it states and shows, as a keyed digest, and its corners; empty if it cannot be decoded
    times            INTEGER NOT NULL, -- how often it was sent
    sender           TEXT   NOT NULL CHECK (sender IN ('stow', 'c-store', 'retrieval')),
    last_at          INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

CREATE INDEX images_by_age ON images (last_at);

-- Instances that rejection notes have rejected, until that is lifted; and results of ours that a note of ours has withdrawn.
CREATE TABLE rejections (
    -- As the note states them; empty for results of ours, whose UIDs are in no other series.
    study_uid        TEXT   NOT NULL,
    series_uid       TEXT   NOT NULL,
    sop_instance_uid TEXT   NOT NULL,
    rejected_at      INTEGER NOT NULL,
    id               TEXT   NOT NULL, -- of what one note rejects of one series
    rejected_by      TEXT   NOT NULL,
    may_return       INTEGER NOT NULL, -- whether an image counts again when it comes again
    PRIMARY KEY (sop_instance_uid, study_uid, series_uid)
) STRICT, WITHOUT ROWID;

CREATE INDEX rejections_by_age ON rejections (rejected_at);
CREATE INDEX rejections_by_id ON rejections (id);

-- Why what is made of images is closed; 0 if it is open. An image that moved to another study is not rejected by a note about the former
-- one.
CREATE VIEW closed_by AS
SELECT made_of.case_id, made_of.layer_id, made_of.result_id,
       max(CASE WHEN images.fingerprint <> '' AND images.fingerprint <> made_of.fingerprint THEN 2
                WHEN EXISTS (SELECT 1 FROM rejections
                             WHERE rejections.sop_instance_uid = made_of.sop_instance_uid AND rejections.study_uid <> ''
                               AND (images.sop_instance_uid IS NULL
                                    OR rejections.study_uid = images.study_uid AND rejections.series_uid = images.series_uid))
                THEN 1 ELSE 0 END) AS why
FROM made_of LEFT JOIN images ON images.sop_instance_uid = made_of.sop_instance_uid
GROUP BY made_of.case_id, made_of.layer_id, made_of.result_id;

-- Results that are sent to a node, or were. Each is an object of the kind `result`; sending it is a job with its id as the key.
CREATE TABLE results (
    id                TEXT NOT NULL PRIMARY KEY,
    case_id           TEXT NOT NULL REFERENCES cases (id) ON DELETE CASCADE,
    node              TEXT NOT NULL,
    sop_instance_uid  TEXT NOT NULL,
    study_uid         TEXT NOT NULL,
    digest            TEXT NOT NULL,
    created_at        INTEGER NOT NULL,
    -- Its class and its series, by which a rejection note names it.
    sop_class_uid      TEXT    NOT NULL,
    series_uid         TEXT    NOT NULL,
    layers             TEXT    NOT NULL DEFAULT '', -- the ids of the layers that it shows or may show, separated by spaces
    closed             INTEGER NOT NULL DEFAULT 0,  -- as of `cases`, for those layers
    UNIQUE (sop_instance_uid, node)
) STRICT, WITHOUT ROWID;

CREATE INDEX results_by_case ON results (case_id);
CREATE INDEX results_by_age ON results (created_at, id);
CREATE INDEX results_by_digest ON results (digest);
CREATE INDEX results_by_study ON results (study_uid);
