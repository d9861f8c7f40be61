-- What readers must know of the plant: where the objects of raw frames are.
CREATE TABLE setting (name text PRIMARY KEY, value text NOT NULL);
