-- What a search tells about a result: its series. Results of earlier versions have none, and are not listed.
ALTER TABLE results ADD COLUMN sop_class_uid TEXT;
ALTER TABLE results ADD COLUMN series_uid TEXT;
ALTER TABLE results ADD COLUMN series_number INTEGER;
ALTER TABLE results ADD COLUMN series_description TEXT;

CREATE INDEX results_by_study ON results (study_uid);
