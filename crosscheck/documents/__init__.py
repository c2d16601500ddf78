"""The source documents: their systems, the ledger of every number they print, and what the page shows of them."""
