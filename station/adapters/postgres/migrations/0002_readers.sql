-- People ask through database roles of their own; which stations and products each may see stands in `grants`.
-- '' stands for all of them.
CREATE TABLE grants (name text NOT NULL, station text NOT NULL, product text NOT NULL,
    PRIMARY KEY (name, station, product));
CREATE VIEW my_grants AS SELECT station, product FROM grants WHERE name = current_user;

ALTER TABLE attempt ENABLE ROW LEVEL SECURITY;
CREATE POLICY granted ON attempt FOR SELECT USING (
    EXISTS (SELECT 1 FROM my_grants WHERE station = '' AND product = '')
    OR station IN (SELECT g.station FROM my_grants g WHERE g.product = '')
    OR product_name IN (SELECT g.product FROM my_grants g WHERE g.station = '' AND g.product <> '')
    OR (station, product_name) IN (SELECT g.station, g.product FROM my_grants g));

ALTER TABLE log ENABLE ROW LEVEL SECURITY;
CREATE POLICY granted ON log FOR SELECT USING (
    EXISTS (SELECT 1 FROM my_grants g WHERE g.station = '' OR g.station = log.station));
ALTER TABLE document ENABLE ROW LEVEL SECURITY;
CREATE POLICY granted ON document FOR SELECT USING (
    EXISTS (SELECT 1 FROM my_grants WHERE station = '' AND product = '')
    OR EXISTS (SELECT 1 FROM attempt a WHERE a.recipe = document.seq)
    OR EXISTS (SELECT 1 FROM attempt a WHERE a.product = document.seq));
ALTER TABLE event ENABLE ROW LEVEL SECURITY;
CREATE POLICY granted ON event FOR SELECT USING (
    EXISTS (SELECT 1 FROM my_grants WHERE station = '' AND product = '')
    OR (attempt IS NULL AND log IN (SELECT l.id FROM log l))
    OR EXISTS (SELECT 1 FROM attempt a WHERE a.seq = event.attempt));
DO $$
DECLARE tab text;
BEGIN
    FOREACH tab IN ARRAY ARRAY['visit', 'write', 'result', 'finish', 'archive'] LOOP
        EXECUTE format('ALTER TABLE %I ENABLE ROW LEVEL SECURITY', tab);
        EXECUTE format('CREATE POLICY granted ON %1$I FOR SELECT USING (
            EXISTS (SELECT 1 FROM my_grants WHERE station = '''' AND product = '''')
            OR EXISTS (SELECT 1 FROM attempt a WHERE a.seq = %1$I.attempt))', tab);
    END LOOP;
END $$;
