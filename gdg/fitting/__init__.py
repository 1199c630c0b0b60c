"""What fitters by gradient share: the energy of a hand against contact maps, and its descent.

``options`` has the settings that all of them take (light), ``energy`` the paper's energy,
``particles`` the fitter that many particles per map descend in, in one or several rounds.
"""
