"""Sizes of the ensembles that `ensemble` measures and that its captions name."""

FEW = 8  # steps of a short run
RIVALS = {"numba": 128, "heyoka": 64}  # how many tops, by engine
JUDGED = 8  # errors are measured on the first so many tops
FIELD_SPAN, FIELD_TOPS, FIELD_JUDGED = 1000.0, 512, 3  # the truth takes some 3 s for each top
