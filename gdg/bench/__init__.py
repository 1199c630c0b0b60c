"""``gdg bench``: the paper's tables, with our numbers beside the published ones.

``tables`` says what they consist of (light), ``run`` evaluates their rows as ``gdg eval`` does.
``weights`` finds what weights they need, ``trained_on`` refuses those that were trained otherwise,
``recipes`` says how to train them. ``claims`` judges what the paper says by intervals, ``output``
writes text, Markdown, CSV and a figure.
"""
