"""Every quality flag that a result may carry, with its meaning: the only place where the words stand."""

APPARENT_SOURCE = "apparent source: not corrected for scattering"
"""Stands beside every position, and every fit to positions or arrival times, that was not corrected."""

LOCALISABLE, CATALOGUED, REJECTED = "localisable", "catalogued", "rejected"
"""Tiers of a detection."""

DISAGREE_SD = 3.0
"""Tension, in standard deviations, from which the ingredients of a fit disagree."""

NOT_CONSTRAINED = 0.9
"""A parameter whose posterior is wider than this share of its prior has not been measured."""

LOCALISATION_FLAGS = {
    "speed_not_constrained": "The posterior of the propagation speed is wider than 0.9 of its prior: the timing says "
    "nothing about it. Always so with three receivers, where any speed fits.",
    "speed_above_c": "The arrival times prefer a speed above that of light (probability above 0.95): unphysical, so a "
    "position, a time or an error is wrong.",
    "x_not_constrained": "Along x the position is wider than 0.9 of its prior: there the answer is the prior.",
    "y_not_constrained": "Along y the position is wider than 0.9 of its prior: there the answer is the prior.",
    "z_not_constrained": "Along z, out of the ecliptic plane, the position is wider than 0.9 of its prior: there the "
    "answer is the prior.",
    "position_not_constrained": "Along some direction the position is wider than 0.9 of its prior: there the answer "
    "is the prior.",
    "prior_dominated": "The prior of the position moves the mean by more than half a standard deviation: where the "
    "source is said to be depends on where sources were assumed to be.",
    "multimodal": "Several separate positions explain the arrival times; mean and covariance describe none of them.",
    "arrivals_inconsistent": "No source explains the arrival times within their errors: one of them, or its error, is "
    "wrong, and the position means nothing.",
    "bad_arrival": "An arrival time is more likely bad than good, and the solution does without it.",
    "clock_offset": "The clock of a spacecraft is off by more than three standard deviations, over all frequencies of "
    "the burst: the solution says which one, or which few may be it, and by how much.",
    "two_roots": "Two positions explain the arrival times exactly; the one nearer the Sun is given.",
    "no_exact_root": "No position explains the arrival times as exactly as it should: with few receivers noise can do "
    "that. The position is that of the least misfit, and its error is limited by the region that was searched.",
    "few_effective_draws": "The draws carry less than half of the information of independent ones.",
}
"""Flags of one frequency of a solution."""

TRACK_FLAGS = {
    "formal_errors": "Formal errors: they take the positions as independent, but positions from smoothed t(f) curves "
    "share their errors, and the true ones are several times larger.",
    "too_few_positions": "Fewer than three positions, or all at one distance: no spiral was fitted.",
    "not_a_spiral": "The longitude does not fall with distance within the errors: no solar wind speed follows from "
    "this track.",
    "too_few_frequencies": "Fewer than four frequencies, or than twelve arrival times: no track was fitted.",
    "v_sw_not_constrained": "The 68 % interval of the wind is not narrower than that of its prior: it is not measured.",
    "phi0_not_constrained": "The 68 % interval of the longitude at the Sun is nearly that of the whole circle.",
    "several_tracks": "Separate longitudes explain the arrival times: take the list of intervals, not the median.",
    "poor_fit": "The best track misses the arrival times by more than their errors would give once in 10 000 times: "
    "the model or an error is wrong.",
    "errors_too_large": "The best track misses the arrival times by less than their errors would give once in 10 000 "
    "times: the stated errors are too large, and so are the intervals.",
    "components_differ": "If light curves had the same shape at all spacecraft, chi-squared would be above 2.5 per "
    "degree of freedom, or their widths differ by a third: spacecraft may hear different components (fundamental and "
    "harmonic), or several injections.",
    "not_one_source": "The arrival times are not those of one source on one spiral: spacecraft hear different "
    "components or bursts, or a clock is wrong. Errors of 0.45 of the rise and a minute per spacecraft were added; the "
    "numbers are not to be used.",
    "edges_differ": "Edges differ between spacecraft by a smooth error of 0.15 of the rise or more that the table does "
    "not state; it was added: the edges may belong to different bursts, or follow different rules.",
    "clock_offset": "A timing offset of a spacecraft is more than three of its standard deviations: its clock or "
    "time scale (terrestrial time is 69.184 s ahead of UTC), or its edges, are wrong.",
    "two_spacecraft": "Three spacecraft were timed in less than 0.6 of the band: elsewhere no error would show.",
    "beam_speed_unlikely": "The beam would be faster than 0.6 c or slower than 0.03 c: edges of different bursts, or a "
    "wrong clock, give such tracks.",
    "poor_weights": "Fewer than 400 effective draws: the numbers are rough.",
    "arrivals_down_weighted": "Arrival times that miss what all others predict by more than six standard deviations "
    "were left out.",
    "one_edge": "Preliminary track: only one definition of the edge was fitted, and no second one that confirms it.",
    "ingredients_disagree": "Arrival times, wave directions and the known wind contradict one another by more than "
    "three standard deviations: one of them, or its error, is wrong.",
}
"""Flags of a fit to the track of a burst."""

OPEN_PROFILE = "open_profile"
NOT_COMPUTED = "not_computed"

COMPANION_FLAGS = {
    "beam_speed_not_positive": "The best fit has lower frequencies leave first: these times are not those of a beam on "
    "this spiral.",
    OPEN_PROFILE: "Some longitude on every side explains the times about as well: the interval has no ends.",
    NOT_COMPUTED: "This could not be computed from this burst; the reason stands beside it.",
}
"""Flags of what is computed beside a track fit; they are not among those of the solution."""

EDGE_FLAGS = {
    "no_samples": "Too few samples in the channel.",
    "no_signal": "Nothing above the background and its noise.",
    "no_flank": "The burst is above half of its maximum from the first sample on, or no rise fits the samples.",
    "no_decay": "Highest at the last sample: the maximum is unknown.",
    "gap_in_flank": "Samples are missing where the burst rises.",
    "saturated": "The light curve stays at its highest value: the receiver has cut the maximum off, and half of it is "
    "unknown.",
    "edges_disagree": "The half-rise and the half-maximum of the same maximum differ by more than their errors allow: "
    "not a single burst, and neither is given.",
    "fit_failed": "No curve fits the samples: not a single burst, or the samples are not what they seem.",
    "outlier": "Far from the curve through the other channels of the spacecraft, or with too large an error.",
    "peak_outside": "The peak of the Gauss-Hermite curve, or its edge, is outside the samples.",
}
"""Why a channel has no edge, in the column ``flag`` of the arrival table."""

FLAGS = LOCALISATION_FLAGS | TRACK_FLAGS
"""Name and meaning of every flag of a solution."""

HARMLESS_FLAGS = frozenset({"speed_not_constrained", "formal_errors", "v_sw_not_constrained"})
"""Flags that nearly every solution has, or that its sentence says: they neither lower a grade nor stand in a list."""

SERIOUS_FLAGS = frozenset(
    {
        "arrivals_inconsistent",
        "beam_speed_unlikely",
        "clock_offset",
        "components_differ",
        "edges_differ",
        "ingredients_disagree",
        "multimodal",
        "not_a_spiral",
        "poor_fit",
        "position_not_constrained",
        "prior_dominated",
        "speed_above_c",
        "two_spacecraft",
    }
)
"""Flags after which errors may not hold: no grade above C."""

UNUSABLE_POSITION_FLAGS = frozenset({"arrivals_inconsistent", "multimodal", "position_not_constrained"})
"""Flags of a frequency whose position is not counted among the distances of a burst."""
