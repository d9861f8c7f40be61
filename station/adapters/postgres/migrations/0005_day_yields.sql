-- Counts of finished attempts by day of their start (UTC), kept at arrival: a dashboard asks for weeks of them.
CREATE TABLE day_yield (
    day bigint NOT NULL, station text NOT NULL, nest text NOT NULL, recipe_name text NOT NULL,
    recipe_version bigint NOT NULL, product_name text NOT NULL, attempts bigint NOT NULL, passed bigint NOT NULL,
    failed bigint NOT NULL, errors bigint NOT NULL, aborted bigint NOT NULL, interrupted bigint NOT NULL,
    units bigint NOT NULL, first_pass bigint NOT NULL, final bigint NOT NULL, final_pass bigint NOT NULL,
    took_ns numeric NOT NULL,
    PRIMARY KEY (day, station, nest, recipe_name, recipe_version, product_name)
);

-- Counts what ended in these records, and takes back the last place of those whose unit came again in them.
CREATE FUNCTION count_yields(from_seq bigint, to_seq bigint) RETURNS void LANGUAGE sql AS $$
    INSERT INTO day_yield AS known
    SELECT started_ns / 86400000000000, station, nest, recipe_name, recipe_version, product_name, sum(one),
        sum(one * (outcome = 'PASS')::int), sum(one * (outcome = 'FAIL')::int), sum(one * (outcome = 'ERROR')::int),
        sum(one * (outcome = 'ABORTED')::int), sum(one * (outcome = 'INTERRUPTED')::int),
        sum(first), sum(first * (outcome = 'PASS')::int), sum(last), sum(last * (outcome = 'PASS')::int), sum(took)
    FROM (
        SELECT a.*, f.outcome, 1 AS one, (n.seq IS NULL)::int AS first, (e.seq IS NULL)::int AS last,
            f.ended_ns - a.started_ns AS took
        FROM finish f JOIN attempt a ON a.seq = f.attempt
        LEFT JOIN repeat n ON n.seq = a.seq LEFT JOIN repeat e ON e.earlier = a.seq
        WHERE f.seq BETWEEN from_seq AND to_seq
        UNION ALL
        SELECT a.*, f.outcome, 0, 0, -1, 0
        FROM repeat r JOIN attempt a ON a.seq = r.earlier JOIN finish f ON f.attempt = a.seq AND f.seq < from_seq
        WHERE r.seq BETWEEN from_seq AND to_seq
    ) x GROUP BY 1, 2, 3, 4, 5, 6
    ON CONFLICT (day, station, nest, recipe_name, recipe_version, product_name) DO UPDATE SET
        attempts = known.attempts + excluded.attempts, passed = known.passed + excluded.passed,
        failed = known.failed + excluded.failed, errors = known.errors + excluded.errors,
        aborted = known.aborted + excluded.aborted, interrupted = known.interrupted + excluded.interrupted,
        units = known.units + excluded.units, first_pass = known.first_pass + excluded.first_pass,
        final = known.final + excluded.final, final_pass = known.final_pass + excluded.final_pass,
        took_ns = known.took_ns + excluded.took_ns;
$$;
SELECT count_yields(0, 9223372036854775807);

ALTER TABLE day_yield ENABLE ROW LEVEL SECURITY;
CREATE POLICY granted ON day_yield FOR SELECT USING (
    EXISTS (SELECT 1 FROM my_grants WHERE station = '' AND product = '')
    OR station IN (SELECT g.station FROM my_grants g WHERE g.product = '')
    OR product_name IN (SELECT g.product FROM my_grants g WHERE g.station = '' AND g.product <> '')
    OR (station, product_name) IN (SELECT g.station, g.product FROM my_grants g));
DO $$ BEGIN
    IF EXISTS (SELECT 1 FROM pg_roles WHERE rolname = 'plant_reader') THEN
        GRANT SELECT ON day_yield TO plant_reader;
    END IF;
END $$;
