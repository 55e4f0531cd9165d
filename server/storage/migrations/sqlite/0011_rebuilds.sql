-- Cases whose derived objects some process is making again: the others wait for it instead of doing the same.
CREATE TABLE rebuilds (
    case_id     TEXT    NOT NULL PRIMARY KEY REFERENCES cases (id) ON DELETE CASCADE,
    holder      TEXT    NOT NULL,
    lease_until INTEGER NOT NULL
) STRICT, WITHOUT ROWID;
