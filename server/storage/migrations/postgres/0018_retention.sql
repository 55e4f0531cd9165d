-- The columns are those of SQLite (../sqlite), where they are explained.
ALTER TABLE cases ADD COLUMN kept BOOLEAN NOT NULL DEFAULT FALSE;
ALTER TABLE cases ADD COLUMN uploaded_at BIGINT;
