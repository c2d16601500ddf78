"""The benchmark: this project against the same work in C, every engine's fastest route, SciPy, and the closed form.

=============== ===================================================================================
`works`         what is to be computed: one four-bar, many, long chains
`closed_form`   the four-bar by trigonometry, on numbers of any length: truth in long double, and the limit in double
`accuracy`      how far an answer is from the truth, and how far it may be
`routes`        one way to do a work: what is timed, what it answers, who drives its loop
`own_routes`    this project's routes; `numpy_routes`, `c_routes`, `exudyn_routes`, `pinocchio_routes`, `mujoco_routes`
`measure`       all routes of a work in turns, in a process whose numerical libraries have one thread
`first_use`     what the first use of the fast path costs
`aims`          what is to be reached, and whether a run reached it
`run`, `show`   the command `crosscheck bench`: the processes, the JSON, the tables
=============== ===================================================================================

Every row is measured twice in one run: its price, and the error of the answers it gave.
"""
