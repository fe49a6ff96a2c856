"""Rows on disk: the store, where rows come from, and what two stores differ in. The data lie beside the code."""
