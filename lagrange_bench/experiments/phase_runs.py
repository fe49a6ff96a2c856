"""The runs of the experiment `phase` that its figures speak of. Times are in units of 1/(|J| + √(|alpha||x|))."""

# tops of the runs against h, and the length of these
STATES = {"quick": ("generic", "through_pole"), "full": ("generic", "figure1", "fast", "through_pole")}
SPAN = 64.0
PROMISE_H = (0.03, 0.1, 0.3, 1.0, 2.0, 3.0, 5.0, 7.0, 11.0)  # steps of the part “promise”
