r"""Every width, odds, range and threshold of the diagnosis: its unit, and where it is from.

Where no source is given the value was set by hand while the diagnosis was written, on recordings of
the simulators, and no derivation is known. The tests ``test_prior*.py`` hold what those decide that
a verdict hangs on; what bounds time or memory alone says so. Log odds and log Bayes factors are
natural; "its scale" is the usual size that an effect declares for a parameter.
"""

import numpy as np
from scipy.special import logsumexp

# At most so many rounds of what hangs on its own answer, unless it settles before: a search, a
# posterior about a new fit, gross rows given the causes. Two or three are usual; where many causes
# do nearly as well, a climb of three rounds and one of four can end in different ones (KR300).
ROUNDS = 4
ALARM = 0.01  # probability that what is right is accused: of a gross row, of rows missed by too far

# Evidence (posterior/evidence). Gelman et al. (2013), Bayesian Data Analysis, sec. 14.8.
# The width of a prior, over its scale, is summed over a grid of three decades about one, log-normal
# with three quarters of a decade: a declared scale is meant to within a decade.
SCALES = 10.0 ** np.linspace(-1.5, 1.5, 7)
LOG_SCALE_WEIGHTS = -0.5 * (np.log10(SCALES) / 0.75) ** 2
LOG_SCALE_WEIGHTS = LOG_SCALE_WEIGHTS - logsumexp(LOG_SCALE_WEIGHTS)
# Equations that a stated noise is worth: what is worked out from n of them is known to
# 1 / sqrt(2 n), 16 % (JCGM 100:2008, table E.1).
STATED_NOISE_FREEDOM = 20.0
# The same given all that may be at work, 7 %: a noise that gives way more takes a gross row or two
# for a part of it, and a slip or a bump of the base for what is left of them (test_gross_rows.py).
KNOWN_NOISE_FREEDOM = 100.0
# Rounds of noise and priors that weigh each other: a gap may be 1e4 times the noise. Half as many
# move a probability by 5e-5.
VARIANCE_ROUNDS = 8
# Change of a variance, a lever, a correlation or of how many rows they count as [before, or both],
# up to which they have settled; by hand (test_correlated_rows.py fails at 0.9).
SETTLED_WITHIN = 0.15
FINEST = 1e-8  # [m or rad] noise of the finest device; below are rounded digits
ROUNDING = 1e-12  # [m or rad] what double arithmetic leaves of readings made without noise

# Rows, or blocks of them, that are enough where more cost time or memory alone: a search's first
# part, a joint's way to its play (40 of each to-and-fro of a hundred), what a design looks back
# upon (minutes of a usual log), blocks of which rows left out are drawn (32 MB).
MANY_ROWS = 4000
# Ranges of each thing that was recorded, in which gross rows may lie together, and places about
# which local bumps are tried: 40 of each to-and-fro of a hundred rows (cost only).
PLACES = 40
FEWEST_BETWEEN = 4  # rows between two bumps of the base; fewer are gross rows by another name

# Selection (posterior/selection). Odds that a slot is filled, before the data: what is diagnosed
# has a cause about as often as not, and one cause more is rare.
FIRST_SLOT_ODDS, NEXT_SLOT_ODDS = 0.7, 0.1
# How alike the causes of one robot are: k of them are of some ALIKE log(1 + k / ALIKE) effects. The
# UR5's 14 are of 4, panda-1's 12 of 6, the KUKA's 8 of 3, the KR 300's 3 of 2: 1.3 to 4.
ALIKE = 2.0
# Terms from which pairs are no longer tried, and folds ask the slots of all rows again: of the
# UR10's 190 a fold that begins with none ends in others, and leaves 56.3 um, not 54.6.
MANY_SLOTS = 40
# Variants of which each is tried as the first of a pair, not the best of each cause: a joint's
# friction has a dozen (test_efforts.py fails at 8); above, cost alone.
FEW_VARIANTS = 20
BETTER = 1e-6  # log odds by which another model must win: more than rounding

# Search (posterior/search).
WIDE_PRIOR = 30.0  # width about its fit of what is always fitted [its scale]: data decide
DRAWS = 200  # of orders, or readings: their means are known to some per cent

# Short lists of dense families (posterior/shortlists); sizes bound memory.
LEAST_SHORTLIST = 6
MOST_COLUMNS = 80  # of a family's variants on the short list, together
NO_EVIDENCE = 3.0  # log Bayes factor, or divergence, below which rows tell nothing (Jeffreys 1961)
# Chosen ones of a dense family of which finer variants are tried: all of the UR10's 190 take 5 GB;
# all of the UR5's leave 54.0 um, not 54.2.
MOST_REFINED = 12

# Gross errors (posterior/robust). Belsley, Kuh, Welsch (1980), sec. 2.1.
ANISOTROPY = 1.7  # ratio of squares up to which one axis, or joint, may be noisier than all
MOST_GROSS_SHARE = 0.2  # of all rows: were there more, it would be an effect
LEVER_CHANGE = (0.1, 10.0)  # of the usual lever between noises of position and rotation

# Noise (posterior/noise).
FEWEST_REPEATS = 6  # degrees of freedom: sigma is then known to 17 % (18 numbers)

# Correlated rows (posterior/correlation).
CORRELATIONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)  # that are tried
# Noise of a clock along the way, at the rows' usual speed, over that of the device; tried.
JITTERS = tuple(2.0 ** (k / 4.0) for k in range(-6, 21))
# Share of what the joint moves that moves most, below which a joint is not asked whether it
# scatters: panda-3's joint 7, on whose axis the ball sits, would by 0.8 rad. Between a tip on the
# axis and a wrist's lever by hand (test_scatter.py fails at 0.02 and 0.1).
LEAST_SWING = 0.05

# Spectra that are carried to another recording (posterior/spectrum), MacKay (1992), sec. 4.
SPECTRUM_FROM = 3  # orders of one joint that make a spectrum: a transmission alone has two
HIGHEST_ORDER = 40  # of a spectrum; orders above it stay single (test_gear_spectra.py)

# Unknown dependences (discrepancy).
USUAL = 3e-4  # [m or rad] usual size of an unknown shift or turn
# [rad, spread of places, or a joint's largest load] over which what is unknown is smooth; the
# first two are widths of local bumps, too [the cloud's, or the first reach]
REACHES = (0.25, 0.6, 1.5)
FULLEST = 15  # columns of a family, its leading ones (cost only)
TURNS, MESHES = 6, 3  # orders of one angle, and of a second one
WARMTH = 3  # cosines of a temperature, or of a link's time: what warms up does so slowly
PLAYS = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)  # widths of play operators [joint's travel]
FORMS = 8  # cosines, and steps, of time or of what went before
MOST_COMPARED_ROWS = 600  # evenly spread (cost only)
# [m or rad] usual size of a row's own displacement, from 0.1 mm to 0.1 m with its widths: from a
# knock to the next marker, read in this one's place. With narrower ones a row 0.2 m off makes
# smooth mechanisms of its neighbours.
DISPLACED = 3e-3
MOST_GROSS_ROWS = 20  # distrusted rows that a family may explain instead
GROSS_ODDS = 0.01  # of a row to be grossly wrong
NOISE_NEGLIGIBLE = 5.0  # log odds behind which one kind of noise need not be weighed
EXTREME = 100.0  # residual of a distrusted row [usual one] beyond which no smooth effect is meant
LEAST_SPREAD = 0.05  # of the noise's variance that one axis has [mean]

# The joint posterior (posterior/joint, discrepancy).
UNLISTED = 0.2  # prior probability that a term is of no effect of the library (``--unlisted``)
# Listed effects with an unlisted mechanism, which need not be one term of ours, are parts of it
# with this probability though their place, or what drives them, is another; of both, its square.
# What its place cannot move may speak against that (posterior/parts.py; test_joint_posterior.py).
PART_OF_UNLISTED = 0.4
RESEMBLING = 0.3  # share of these that resemble an effect of the library (test_resembling.py)
DEVIATIONS = (0.3, 1.0)  # of such a mechanism from that effect [the effect], root of squares
# What a listed effect leaves of a form [the form], up to which it is that: of 4 sigma in 100 rows,
# 300 numbers, it is two standard errors (test_alternatives.py fails at 0.01 and 0.08).
SAME_FORM = 0.03
MOST_RESEMBLED = 4  # effects at each look with which such mechanisms are tried
MOVES = 120  # of a chain: seeds then repeat marginals to 0.01 (test_joint_posterior.py)
LONG_MOVES = 600  # of each chain of a long state, of one place each (test_joint_posterior.py)
LEAST_ASKED = 1e-4  # largest share of a place below which they do not ask a term (cost only)
# Log odds behind the best at which a state does not count: all of them together hold 1e-4, and to
# keep them costs a third of the time.
NEARLY_NOTHING = 14.0
TILT = 3.0  # factor on prior odds by which the verdict says how much hangs on them
MOST_FAMILIES = 60  # unlisted mechanisms that go on from the first look: the others have no say
# Share of a chain's moves that ask whether a row is gross: if half do, a probability moves by 0.03.
# And of the rest that exchange one term for two or two for one, and of long states' two for two: at
# half of it of four seeds two leave a pair of listed causes unfound that is better by 11 nats
# (test_joint_posterior.py fails at 0.05 and 0.6).
OTHER_MOVES = 0.2
PAIRED = 12  # terms by which pairs are looked for: with 6 of these seeds' chains two part by 0.3
IN_ONE = 0.1  # by hand: prior share of a cause that is at work in one of several recordings alone
LEAST_NAMED = 0.5  # probability of a cause, given those named before it, at which it is named
# A probability below it states nothing; by so much two chains that agree may differ.
LEAST_TOLD = 0.02
EARNED = 1.15  # held-out figure [noise] up to which a gap may be called explained, and is no room

# Rows left out (predict).
MOST_FOLDS = 5  # and blocks; Hastie, Tibshirani, Friedman (2009), sec. 7.10: five or ten
FEWEST_ROWS = 4  # of a fold
LEAST_LEFT = 0.25  # share of the rows that must be left to fit, whichever group is left out
GROSS_KEPT_BACK = 10.0  # residual of a row kept back [median] at which it is a gross error
BOOTSTRAP_DRAWS = 1000  # 25 of them lie beyond either end of a 95 % interval (cost only)
# Root of the share of a fold's square, a ten thousandth, by which its fit may still change: less
# than a figure's last digit. In standard errors it is this times the root of the readings.
FOLD_STILL = 0.01

# Causes that are not named (predict/negligible, verdict/explanation).
NEGLIGIBLE_RISE = 0.01  # of the held-out RMS without a cause, or all spared, below which it is
HELD_OUT_CHANCE = 20.0  # what chance may add to a held-out square [noise's]
# A robot with more lacks more than one thing: none is excluded for an unknown. Chains sample states
# of up to twice as many terms.
MANY_CAUSES = 6

# The verdict.
# Share of unlisted mechanisms that follow nothing recorded: of 115 flagged sealed ones 12.
FORMLESS = 0.1
FAR = 2.0  # ratio of what rows left out are missed by to their noise, whatever the fit leaves
SWALLOWED = 1e-7  # share of a signal that nuisances must leave: what rounding leaves is less

# The next experiment (design).
# Probability of the leading explanation at which nothing is left to separate, and that one more
# cause is at work at which the most probable is named with whatever share it has.
SETTLED = 0.95
HOPELESS = 0.5  # share of the doubt that any number of rows may leave
COOLED = 0.05  # share of its warmth that a rest as long as the recording leaves: 3 time constants
REST_PAYS = 1.2  # how much more a row must add with a rest before it than without

# Simulation-based calibration (calibrate).
NOTHING_WRONG = 0.25  # share of the cases in which nothing is wrong
LEAST_GAP = 0.35  # of a simulated case [noise]: the faintest of the withheld sets
GAP_SPREAD = 2.0  # gaps are drawn between the found one over this and times this
MOST_SIMULATED_CAUSES = 3  # of a case, as many as withheld sets have
SLOPE_WIDTH, OFFSET_WIDTH = 0.5, 1.0  # priors of the recalibration's line about the identity
TRUTH_HELD = 0.9  # share of cases whose true causes the set of causes holds
SUREST = 1e-6  # of a stated probability, from 0 and 1: what it counts for is finite
