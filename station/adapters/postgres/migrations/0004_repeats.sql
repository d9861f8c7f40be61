-- Which attempt is not its unit's first with a recipe, and which one came before: yields ask this of every attempt.
CREATE TABLE repeat (seq bigint PRIMARY KEY, earlier bigint NOT NULL UNIQUE);
INSERT INTO repeat SELECT * FROM (SELECT seq, lag(seq) OVER (PARTITION BY serial, recipe_name ORDER BY seq) AS earlier
    FROM attempt) a WHERE earlier IS NOT NULL;
