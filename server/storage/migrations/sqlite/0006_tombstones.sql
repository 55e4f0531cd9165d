-- Objects that nobody needs and that are being removed. While a tombstone is there the object cannot be pinned, so that nobody
-- refers to it; if whoever removes it is killed, another one takes over after `lease_until`.
CREATE TABLE tombstones (
    kind        TEXT    NOT NULL,
    digest      TEXT    NOT NULL,
    holder      TEXT    NOT NULL,
    lease_until INTEGER NOT NULL,
    PRIMARY KEY (kind, digest)
) STRICT, WITHOUT ROWID;
