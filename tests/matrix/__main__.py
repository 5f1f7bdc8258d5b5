"""``python -m tests.matrix`` writes into the golden files what more builds now, and refuses what builds no more.

It writes docs/reference/combinations.md, too.
"""

from tests.matrix.features import KINDS
from tests.matrix.outcomes import GOLDEN, gains, golden, row, text, update
from tests.matrix.page import PAGE, current

for kind in KINDS:
    file = GOLDEN / f"{kind.name}.txt"
    before = golden(kind.name) if file.exists() else {}
    now = {name: row(kind, name) for name in kind.features}
    for line in gains(before, now):
        print(f"{kind.name}: {line}")
    file.write_text(text(update(before, now)), encoding="utf-8")

PAGE.write_text(current(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
