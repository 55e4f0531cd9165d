-- Whether the case was made of images that a PACS has sent. What was uploaded takes the place of none of these.
ALTER TABLE case_series ADD COLUMN is_received BIGINT NOT NULL DEFAULT 0;

UPDATE case_series SET is_received = 1 WHERE case_id IN (SELECT case_id FROM arrivals WHERE case_id IS NOT NULL);
