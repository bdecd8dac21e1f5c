"""Reports: pages, tables and figures of an evaluation."""
