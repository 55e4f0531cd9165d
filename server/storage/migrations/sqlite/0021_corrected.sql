-- Images that took the place of others with the same UID, and objects that were not kept.
ALTER TABLE arrivals ADD COLUMN superseded INTEGER NOT NULL DEFAULT 0;
ALTER TABLE arrivals ADD COLUMN ignored INTEGER NOT NULL DEFAULT 0;

-- Whether the patient or the study was corrected since a case was made.
ALTER TABLE case_series ADD COLUMN superseded INTEGER NOT NULL DEFAULT 0;
