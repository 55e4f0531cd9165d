-- The last time that was believed by the removal of what a PACS has sent, which is kept for another time than cases.
ALTER TABLE expiry ADD COLUMN received_seen_at INTEGER;
UPDATE expiry SET received_seen_at = seen_at;
