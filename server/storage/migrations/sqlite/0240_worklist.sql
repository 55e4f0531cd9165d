-- What the list of cases is sorted and filtered by. The program that opens the store writes both columns of the cases that are there.
ALTER TABLE cases ADD COLUMN label_key TEXT; -- the label as its bytes sort naturally; '' without a label
ALTER TABLE cases ADD COLUMN mask      TEXT; -- the rating of the mask, when ready; '' without one

CREATE INDEX cases_without_label_key ON cases (id) WHERE label_key IS NULL;
