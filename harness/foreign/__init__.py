"""Motions computed by any other code: tables read, what they hold recognised and checked, judged like a run."""
