"""The page of a view, with viser: it shows a desk and passes on what its clients ask for."""
