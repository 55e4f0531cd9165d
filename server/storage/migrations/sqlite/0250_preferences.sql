-- What named users have chosen and saved for themselves, of no case. The page owns the content.
CREATE TABLE preferences (
    user_name  TEXT    NOT NULL PRIMARY KEY, -- as the reader of a reading
    document   TEXT    NOT NULL, -- JSON
    changed_at INTEGER NOT NULL
) STRICT;
