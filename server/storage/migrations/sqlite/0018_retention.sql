-- Whether a case is never removed because of its age.
ALTER TABLE cases ADD COLUMN kept INTEGER NOT NULL DEFAULT 0;

-- The latest upload of the same input, from which the age counts; NULL if there was only one.
ALTER TABLE cases ADD COLUMN uploaded_at INTEGER;
