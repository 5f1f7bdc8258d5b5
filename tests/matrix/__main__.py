"""``python -m tests.matrix`` writes what more builds now into docs/combinations.csv, and refuses losses."""

from granular_lmp.studies.features import KINDS
from tests.matrix.outcomes import committed, gains, rows_of, update, write

before = committed()
now = {pair: row for kind in KINDS for name in kind.features for pair, row in rows_of(kind, name).items()}
for line in gains(before, now):
    print(line)
write(update(before, now))
