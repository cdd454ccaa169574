"""Every threshold of a registration, with its unit and where it is from.

What names no source was chosen; the grades of a target and what they are worth are measured by
``plumbline.experiments.benches.registration_coverage``.
"""

from math import log

import numpy as np

# What is a marker
LARGEST = 5.0  # [m]: no two markers are farther apart, nor does an arm reach farther
COARSEST = 0.05  # [m]: no CT has thicker slices, no arm errs by more
FEWEST = 3  # markers: what holds a rigid fit
FEWEST_DIAGNOSED = 4  # markers: three have three distances, whatever moved changes some of them
SAME_PLACE = 1e-9  # [m]: places in CT of one marker, as written more than once
FINEST_GRID = 2e-4  # [m]: no CT of a head has thinner slices; coordinates have more digits
ON_GRID = 1e-6  # [m], and of a noise: what differs by less is the same
COINCIDENT = 1e-6  # [m] between two markers: one place
MILLIMETRES = (300.0, 3000.0)  # times as far apart in one frame as in the other: mm against m
ON_A_LINE = 1.0  # [deg], smallest inner angle of the best triple: no plane is held by less

# What is known of the noise
STATED = 8.0  # freedoms of a stated noise: it is known to a quarter (JCGM 100:2008, G.4.2)
UNEVEN = 1e-9  # of a covariance's largest entry: what rounding leaves of asymmetry
EXACT = 1e-12  # of the largest variance: less along an axis is no noise at all
FEWEST_UNSTATED = 4  # markers: three leave three misfits in their plane, none square to it
DRAWS = 4000  # the standard error of a share of 95 % is then 0.35 %
SMALLEST = 1e-13  # [m]: readings that agree exactly still have some noise
LEAST_SHARE = 1e-8  # of the largest variance: what keeps a matrix from being singular
LEAST_FREEDOM = 1e-9  # of an axis: what keeps a variance from a division by zero

# Damped Newton steps (Madsen, Nielsen, Tingleff 2004, sec. 2.4)
STEPS = 60  # at most: chosen; what is stopped is judged, and said
NEARLY = 1e-8  # [m and rad]: a Newton step so small leaves an error of its square
NO_WORSE = 1e-13  # of a sum of squares: what rounding adds to it
LEAST_DAMPING = 1e-3  # of the curvature, where a step first fails (Madsen et al., sec. 3.2: tau)
MORE_DAMPING = 10.0  # times, up or down, from one step to the next (Marquardt 1963)
HOPELESS = 1e6  # damping at which no step is seen to help any more
CHUNK = 4096  # draws at a time: chosen, so that many draws need little memory

# Which markers moved
ALPHA = 1e-3  # chance of leaving a good marker out
ALPHA_UNSTATED = 0.005  # the same where no noise was stated: a stricter test sees gross shifts only
ROUNDING = 1e-24  # squares of markers that agree exactly
RIVAL = 2.0 * log(1000.0)  # of twice the log-likelihood: choices less than 1000 times as likely
EVERY = 100  # choices at most that are all tried
TRIPLES = 2000  # starts at most: with half of the markers bad, 250 of them hold none
STARTS, KEPT = 12, 3  # that are concentrated, and that are kept of them
CONCENTRATIONS = 20  # rounds at most: chosen
SETTLED = 1e-12  # [m, 1] change of a pose that ends them
LEAST_HELD = 5.0  # [deg], smallest inner angle of the best triple that is kept

# Triples
MANY = 24  # markers beyond which some well-spread ones stand for all in what is said of triples
LEAST_ANGLE = 2.0  # [deg]: narrower triples add nothing to the mean
MEAN_ROUNDS = 30  # of the mean pose at most: chosen
STILL = 1e-11  # [m and rad] change of the mean that ends them

# Other labels
ALL_ORDERS = 7  # markers of which all 5039 other orders are compared
FITTED = 12  # of the orders with the nearest distances, so many are fitted
ALIKE = 200  # of all pairs, then triples, most like one of CT's, so many are tried for it; effort

# What is said and refused
DOUBTFUL = 1e-3  # chance of a misfit as large as found, below which the stated noise is doubted
SURPRISING = 0.05  # chance of such misfits under the stated noise, below which nothing is good
RELATIVE_DOUBT = 0.01  # misfit over spread that is doubted, where no noise was stated
NO_PAIR = 0.1  # misfit over spread: no CT and no arm err by so much of it
MUCH, MUCH_UNSTATED = 3.0, 10.0  # times a smaller misfit, with and without a stated noise
NEARLY_ON_A_LINE = 15.0  # [deg], smallest inner angle of the best triple, below which it is said
FLAT = 0.05  # thickness over the second spread, below which markers are in one plane
ASIDE = 0.1  # [m] off the markers' line, where their hold on the rotation is quoted
WIDE_TURN = np.radians(5.0)  # [rad] of rotation error beyond which first order is rough
FINE, COARSE = 2e-3, 5e-3  # [m]: how far a target may be off that is found well, or fairly
ENOUGH_FREEDOMS = 8.0  # of a variance: from fewer, one in twenty is found three times too small

# Statement
POSE = 15  # numbers of a pose in a row: A by columns, t, c
