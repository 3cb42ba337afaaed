"""Every number that steers the integrators: unit, reason, and what breaks when it is larger or smaller.

None is tuned to a scene: most bound what counts as rounding.
"""

# `event`

#: Events within `FALLBACK_S` (s), or a shorter step, after which its rest is given to `stepping` (chatter). Larger: a
#: Zeno sequence costs more before it is cut. Smaller: busy but regular steps lose their order.
MAX_EVENTS, FALLBACK_S = 24, 1e-3
#: s; a step cut below this because the arms do not close is given to `stepping`.
SHORTEST = 1e-8
#: m/s2; a step whose last stage differs from its end by more is cut (an embedded third-order estimate, so the step
#: itself is far better). Larger: errors near singular positions grow. Smaller: quiet steps are cut without need.
STEP_ERROR = 1e-4
#: Sine of an elbow below which a step's energy is checked, too: the rates of the joints are there far more sensitive
#: than the tip's motion. Larger: quiet steps pay for the check. Smaller: the ledger drifts near singular positions.
NEAR_SINGULAR = 0.1
#: Share of the energy that changed hands in a step (above `LEAST_ENERGY`, J) that its ledger may leave unexplained.
#: Larger: energy appears or vanishes near singular positions. Smaller: rounding cuts steps.
ENERGY_ERROR, LEAST_ENERGY = 1e-4, 1e-6
#: N m; a step that may misjudge the course of a lagging yield by more is cut. Larger: long steps lose accuracy where
#: brakes lag and joints reverse. Smaller: quiet steps are cut without need.
YIELD_ERROR = 1e-7
#: Relative; a yield this near to K is K: rounding would keep it from ever arriving. Larger: a yield jumps. Smaller: a
#: brake at rest goes on costing what one costs whose yield changes.
ARRIVED = 2e-15
#: Relative; a joint's rate this near to an edge of Eq. (4) is there. Larger: where a brake's constant jumps at omega_0
#: the order drowns. Smaller: a step is cut a second time, to the rest of the way.
PACE_ROUNDING = 1e-7
#: J; a step in which a brake would give more than this is cut: its joint reversed unseen. Smaller: rounding cuts steps.
GIVEN = 1e-15
#: s; no step is cut below this for its error. Larger: errors remain near singular positions. Smaller: they cost more.
FINEST = 1e-6
#: N; a hand that pushes a resting tip this little beyond what the brakes hold does not move it yet. Larger: the tip
#: leaves rest late. Zero: rounding decides whether it has left, and the solver may not agree.
REST_ROUNDING = 1e-12
#: rad/s, m/s, N m, rad, sine: a value this far below zero is rounding, not an event. Larger: events are seen late.
#: Smaller: rounding is taken for events.
ROUNDING = 1e-12
#: Iterations to locate one event; bracketed, so it ends in any case. Smaller: events are not located to rounding.
MAX_LOCATE = 40
#: As `ROUNDING`, where an event counts as located. Larger: a joint sticks while it still turns, and the order drowns.
#: Smaller: rounding is chased in vain.
LOCATED = 1e-14
#: s; a tried step that ends this near to its event is carried there along its velocity and acceleration. That leaves
#: out half its square times the jerk: 1e-15 m/s at 1e5 m/s3. Larger: the order drowns. Smaller: one more RK4 step.
SLID_S = 1e-10
#: As `ROUNDING`: an event located no nearer than this to zero was a graze, and motion goes on. Larger: a dip that does
#: not reach zero sticks the brake.
GRAZING = 1e-10

#: N s; a step whose evaluations miss the course of the force table by more (force times step) is split at its knots.
#: Larger: a pulse between two evaluations is overlooked. Smaller: noise in a force file costs steps.
FORCE_MISSED = 1e-6
#: s; a schedule row or force knot this near to a step's edge is that edge.
EDGE_S = 1e-9

# The pattern of stick and slip

#: rad/s; a slipping rate this far on the wrong side of zero is rounding left by the location of an event, not motion.
#: Larger: a real reversal is taken for rounding. Smaller: rounding is taken for a reversal and the brake chatters.
RATE_ROUNDING = 1e-12
#: m/s; a tip this slow, two joints of which have no rate, is at rest. Larger: motion is stopped that the brakes cannot
#: stop. Smaller: rounding keeps a stopped tip moving.
REST_SPEED = 1e-10
#: Relative; a hand force this near to the last one is the same, taken at a time that differs by rounding. Larger: a
#: small change between two calls is overlooked for a step. Smaller: nothing breaks, a pattern is worked out again.
HAND_ROUNDING = 1e-9

# Smooth motion

#: Where a stage may be evaluated: |sin| of both elbows above this share of the margin. Larger: fast impacts are cut
#: into many short steps. Smaller: a stage comes near the singular position and its acceleration means nothing.
REACH = 0.3

# `stepping`

#: Step times the hand's fastest rate above which RK4 is not trusted with it (its stability ends at 2.8, its accuracy
#: well before). Larger: a stiff hand gains energy in the integrator. Smaller: order is given up without need.
STIFF = 1.0
#: m; a step over a longer way is halved until it is shorter, since the mass matrix belongs to a place. Larger: fast
#: motion gains or loses energy as the mass changes under it. Smaller: fast motion costs more steps.
LONGEST_WAY = 0.005
#: Share by which the sine of an elbow may change in a step; over more it is halved. Larger: near singular positions
#: the mass matrix changes beyond all use within a step. Smaller: motion there costs more steps.
LARGEST_CHANGE = 0.1
#: Halvings of one step at most.
MOST_HALVINGS = 16
#: Share of the kinetic energy that a step may create by rounding; above it, what was created is taken away.
CREATED = 1e-9
#: Sine or rad; a joint this near to its stop touches it. Larger: a joint is held short of its stop. Smaller: rounding
#: hides that it lies against the stop, and it strikes the stop again each step.
TOUCHING = 1e-10

# `karnopp`

#: rad/s, delta_omega of Eq. (6), the rate below which a joint counts as at rest; a scene may choose its own. Larger:
#: stuck joints creep faster and slow motion sticks. Smaller: a joint passes through the band between two evaluations,
#: and a brake chatters about zero where it should stick (it sticks for sure where one step changes the rate by less).
DELTA_OMEGA = 1e-3
#: Relative; rows whose area is below this share of their lengths' product are parallel for this instant. Larger: a
#: well-held tip slips. Smaller: torques are rounding over rounding.
PARALLEL_ROWS = 1e-9
#: Relative; a stuck torque this far beyond the yield is rounding. Larger: brakes hold more than they can. Smaller:
#: rounding lets a brake slip that is just held.
HELD_ROUNDING = 1e-12

# How stuck brakes share the load

#: N m, half-width that stands for a stop: so much stronger than a brake that the brake is left no load
STOP_STRENGTH = 1e6
#: relative: a split at the bound of what the joints hold is accepted this far beyond it
SPLIT_ROUNDING = 1e-9

# Warnings about a result

#: Share of the energy that changed hands, and J, that a ledger may leave unexplained without a warning. Larger: wrong
#: motion passes without a word. Smaller: the error that a first-order integrator has by its nature is warned of.
UNEXPLAINED, UNEXPLAINED_J = 0.01, 1e-5
#: J; energy that a brake may seem to add in a step: rounding. Smaller: rounding is warned of.
ADDED_J = 1e-9
