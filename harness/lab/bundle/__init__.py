"""Write bundles: a results folder as one file that anybody can check without this package (docs/bundle.md)."""
