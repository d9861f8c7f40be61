-- The records of every station's log. seq: the plant's own number, in the order of arrival over all logs; number: the
-- record's in its log. Columns bear the names of the log's (docs/log-format.md), so one question is asked of both.

CREATE TABLE log (
    id integer GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    station text NOT NULL,
    log_id text NOT NULL,
    branch integer NOT NULL DEFAULT 0,
    parent integer REFERENCES log (id),      -- the branch that this one left after record `base`
    base bigint NOT NULL DEFAULT 0,
    base_seal bytea NOT NULL,
    base_key bytea NOT NULL,
    number bigint NOT NULL,
    seal bytea NOT NULL,
    signature bytea NOT NULL DEFAULT '',
    key bytea NOT NULL,
    revoked text NOT NULL DEFAULT '{}',
    newest bigint NOT NULL DEFAULT 0,
    current boolean NOT NULL DEFAULT true,
    last_ns bigint NOT NULL DEFAULT 0,
    UNIQUE (log_id, branch)
);
CREATE UNIQUE INDEX log_current ON log (station) WHERE current;

-- One row a portion: a signed head of its log, and where its records are.
CREATE TABLE batch (
    log integer NOT NULL REFERENCES log (id),
    first bigint NOT NULL,
    last bigint NOT NULL,
    first_seq bigint NOT NULL,
    seal bytea NOT NULL,
    signature bytea NOT NULL,
    at_ns bigint NOT NULL,
    PRIMARY KEY (log, first)
);

-- Numbers are given out under this row's lock, so that whoever follows seq misses nothing.
CREATE TABLE counter (id boolean PRIMARY KEY DEFAULT true CHECK (id), last bigint NOT NULL, room bigint NOT NULL,
    partition_records bigint NOT NULL);
INSERT INTO counter (last, room, partition_records) VALUES (0, 0, 33554432);

CREATE TABLE quarantine (
    id bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    station text NOT NULL,
    log_id text NOT NULL,
    number bigint NOT NULL,
    reason text NOT NULL,
    message text NOT NULL,
    seal bytea NOT NULL,
    records bytea NOT NULL,
    first_ns bigint NOT NULL,
    last_ns bigint NOT NULL,
    times bigint NOT NULL DEFAULT 1,
    resolved_ns bigint,
    resolved_by text,
    resolution text,
    UNIQUE (station, log_id, number, reason, seal)
);
CREATE INDEX quarantine_open ON quarantine (station) WHERE resolved_ns IS NULL;

CREATE TABLE tree_head (
    id bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    station text NOT NULL,
    log_id text NOT NULL,
    at_ns bigint NOT NULL,
    replaces text NOT NULL,
    head text NOT NULL
);
CREATE INDEX tree_head_station ON tree_head (station, id);

CREATE TABLE object (
    sha256 bytea PRIMARY KEY,
    bytes bigint NOT NULL,
    kept_ns bigint NOT NULL,
    retired_ns bigint
);

CREATE TABLE document (
    seq bigint PRIMARY KEY, log integer NOT NULL, number bigint NOT NULL, hash bytea NOT NULL, signature bytea,
    sha256 text NOT NULL, kind text NOT NULL, text text NOT NULL
) PARTITION BY RANGE (seq);
CREATE INDEX ON document (log, number);

CREATE TABLE attempt (
    seq bigint PRIMARY KEY, log integer NOT NULL, number bigint NOT NULL, hash bytea NOT NULL, signature bytea,
    id text NOT NULL, serial text NOT NULL, station text NOT NULL, nest text NOT NULL, node bigint NOT NULL,
    lot text NOT NULL, recipe_name text NOT NULL, recipe_version bigint NOT NULL, recipe_hash text NOT NULL,
    recipe bigint, product bigint, config_hash text NOT NULL, software text NOT NULL, operator text NOT NULL,
    started_ns bigint NOT NULL, product_name text NOT NULL
) PARTITION BY RANGE (seq);
CREATE INDEX ON attempt (log, number);
CREATE INDEX ON attempt (serial text_pattern_ops, recipe_name);
CREATE INDEX ON attempt (started_ns);
CREATE INDEX ON attempt (recipe_name, started_ns);
CREATE INDEX ON attempt (recipe_hash, started_ns);
CREATE INDEX ON attempt (lot);
CREATE INDEX ON attempt (station, nest, started_ns);
CREATE INDEX ON attempt (recipe);
CREATE INDEX ON attempt (product);

CREATE TABLE event (
    seq bigint PRIMARY KEY, log integer NOT NULL, number bigint NOT NULL, hash bytea NOT NULL, signature bytea,
    attempt bigint, at_ns bigint NOT NULL, kind text NOT NULL, detail text NOT NULL
) PARTITION BY RANGE (seq);
CREATE INDEX ON event (attempt);

CREATE TABLE visit (
    seq bigint PRIMARY KEY, log integer NOT NULL, number bigint NOT NULL, hash bytea NOT NULL, signature bytea,
    attempt bigint NOT NULL, run bigint NOT NULL, visit bigint NOT NULL, "position" text NOT NULL,
    seating text NOT NULL, kind text NOT NULL, arrived_ns bigint NOT NULL, left_ns bigint NOT NULL,
    frame_count bigint NOT NULL, frames_sha256 text NOT NULL, statistics text NOT NULL
) PARTITION BY RANGE (seq);
CREATE INDEX ON visit (attempt);

CREATE TABLE write (
    seq bigint PRIMARY KEY, log integer NOT NULL, number bigint NOT NULL, hash bytea NOT NULL, signature bytea,
    attempt bigint NOT NULL, at_ns bigint NOT NULL, object bigint NOT NULL, sub bigint NOT NULL, name text NOT NULL,
    stage text NOT NULL, value double precision, old bytea, written bytea NOT NULL, read_back bytea
) PARTITION BY RANGE (seq);
CREATE INDEX ON write (attempt);

CREATE TABLE result (
    seq bigint PRIMARY KEY, log integer NOT NULL, number bigint NOT NULL, hash bytea NOT NULL, signature bytea,
    attempt bigint NOT NULL, at_ns bigint NOT NULL, name text NOT NULL, document text NOT NULL
) PARTITION BY RANGE (seq);
CREATE INDEX ON result (attempt);
CREATE INDEX ON result ((document::json ->> 'software'), attempt) WHERE name = 'identity';

CREATE TABLE finish (
    seq bigint PRIMARY KEY, log integer NOT NULL, number bigint NOT NULL, hash bytea NOT NULL, signature bytea,
    attempt bigint NOT NULL, outcome text NOT NULL, ended_ns bigint NOT NULL
) PARTITION BY RANGE (seq);
CREATE INDEX ON finish (attempt);
CREATE INDEX ON finish (outcome, ended_ns);

-- data: the SHA-256 by which the object store keeps the packed frames.
CREATE TABLE archive (
    seq bigint PRIMARY KEY, log integer NOT NULL, number bigint NOT NULL, hash bytea NOT NULL, signature bytea,
    attempt bigint NOT NULL, visits bigint NOT NULL, data bytea NOT NULL
) PARTITION BY RANGE (seq);
CREATE INDEX ON archive (attempt);
CREATE INDEX ON archive (data);

-- Makes the partitions that numbers up to `upto` need. ATTACH locks out neither readers nor COPY.
CREATE FUNCTION make_room(upto bigint) RETURNS void LANGUAGE plpgsql AS $$
DECLARE
    size bigint; start bigint; part text; tab text;
BEGIN
    SELECT partition_records, room INTO size, start FROM counter;
    WHILE start < upto LOOP
        FOREACH tab IN ARRAY ARRAY['document', 'attempt', 'event', 'visit', 'write', 'result', 'finish', 'archive'] LOOP
            part := tab || '_' || (start + 1);
            EXECUTE format('CREATE TABLE %I (LIKE %I INCLUDING ALL)', part, tab);
            EXECUTE format('ALTER TABLE %I ATTACH PARTITION %I FOR VALUES FROM (%s) TO (%s)',
                tab, part, start + 1, start + size + 1);
        END LOOP;
        start := start + size;
    END LOOP;
    UPDATE counter SET room = start;
END $$;

-- Records are append-only; the plant itself never alters one.
CREATE FUNCTION refuse_change() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    RAISE EXCEPTION 'the plant''s records are append-only: % refuses %', TG_TABLE_NAME, TG_OP;
END $$;
DO $$
DECLARE tab text;
BEGIN
    FOREACH tab IN ARRAY ARRAY['document', 'attempt', 'event', 'visit', 'write', 'result', 'finish', 'archive'] LOOP
        EXECUTE format('CREATE TRIGGER append_only BEFORE UPDATE OR DELETE ON %I FOR EACH ROW
            EXECUTE FUNCTION refuse_change()', tab);
    END LOOP;
END $$;
