"""The nightly report: `report.json` and one self-contained page `index.html`, from the files of a run alone.

`summary` reads the records in one pass and decides the verdict, `cells` and `totals` count, `measured`, `prices` and
`disagreements` read the other files, `front` answers in a table, `figures` draws (in `svg`), `wording` has the words,
`build` writes. The page shows nothing that is not in `report.json`.
"""
