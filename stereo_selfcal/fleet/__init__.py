"""Many recordings on many processes, through Dask: one task a recording, or a stretch of a long one.

What runs on a worker (:mod:`.work`) and what is kept of a recording (:mod:`.outcome`, :mod:`.store`) know
nothing of Dask; :mod:`.scheduling` and :mod:`.cluster` are all that do.
"""
