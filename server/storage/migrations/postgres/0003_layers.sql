-- The tables are those of SQLite (../sqlite), where their columns are explained.

CREATE TABLE layers (
    case_id      TEXT COLLATE "C" NOT NULL REFERENCES cases (id) ON DELETE CASCADE,
    id           TEXT COLLATE "C" NOT NULL,
    name         TEXT             NOT NULL,
    place        BIGINT           NOT NULL,
    parameters   TEXT             NOT NULL,
    state        TEXT             NOT NULL CHECK (state IN ('queued', 'preparing', 'ready', 'failed')),
    failure      TEXT,
    facts        TEXT,
    facts_digest TEXT,
    created_at   BIGINT           NOT NULL,
    available_at BIGINT           NOT NULL,
    attempts     BIGINT           NOT NULL DEFAULT 0,
    fence        BIGINT           NOT NULL DEFAULT 0,
    lease_until  BIGINT,
    PRIMARY KEY (case_id, id),
    UNIQUE (case_id, name)
);

CREATE INDEX layers_to_prepare ON layers (available_at) WHERE state IN ('queued', 'preparing');

CREATE TABLE layer_objects (
    case_id  TEXT COLLATE "C" NOT NULL,
    layer_id TEXT COLLATE "C" NOT NULL,
    kind     TEXT COLLATE "C" NOT NULL,
    digest   TEXT COLLATE "C" NOT NULL,
    PRIMARY KEY (case_id, layer_id, kind),
    FOREIGN KEY (case_id, layer_id) REFERENCES layers (case_id, id) ON DELETE CASCADE
);

CREATE INDEX layer_objects_by_name ON layer_objects (kind, digest);

-- A change of a layer is one of its case.
CREATE FUNCTION announce_layer() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    IF TG_OP = 'DELETE' THEN
        PERFORM pg_notify('isocortex', 'changed ' || OLD.case_id);
        RETURN NULL;
    END IF;
    PERFORM pg_notify('isocortex', 'changed ' || NEW.case_id);
    IF NEW.state = 'queued' THEN
        PERFORM pg_notify('isocortex', 'queued');
    END IF;
    RETURN NULL;
END $$;

CREATE TRIGGER announce AFTER INSERT OR UPDATE OR DELETE ON layers
    FOR EACH ROW EXECUTE FUNCTION announce_layer();
