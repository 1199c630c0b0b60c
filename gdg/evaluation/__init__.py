"""``gdg eval``: a grid of settings, each cell planned and tested, summed up in rows.

``run`` drives; ``agenda`` says what is made next, ``tasks`` makes it in a worker; ``rows`` sums up,
``tables`` and ``figure`` show it, ``agreement`` compares simulators.
"""
