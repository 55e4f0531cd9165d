-- BLAKE3 of `facts`, in 64 hexadecimal digits: they hold the affine, and a digit that flips on the disk would move every coordinate.
-- Rows of an earlier version get theirs when the file is opened.
ALTER TABLE cases ADD COLUMN facts_digest TEXT;
