"""The source documents: their systems, and the ledger of every number they print."""
