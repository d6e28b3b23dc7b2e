"""`vsmrc figures`: every number and figure of docs/evidence.md, from jobs that anyone can run again."""
