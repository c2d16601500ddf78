"""The nightly report: `report.json` and one self-contained page `index.html`, from the files of a run alone.

`records` reads them, `cells` and `totals` count, `summary` sums them up in one pass, `verdict` says how the night
ended, `figures` draws, `build` writes. The page shows nothing that is not in `report.json`.
"""
