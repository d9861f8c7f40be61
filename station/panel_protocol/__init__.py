"""What a run and the operator's page tell each other, through files beside the log: names, schemas, locks."""
