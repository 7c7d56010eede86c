"""Many recordings on many processes, through Dask: one task a recording, or a stretch of a long one.

The code of a worker (:mod:`.work`) and the stored outcome of a recording (:mod:`.outcome`, :mod:`.store`) do
not depend on Dask. Only :mod:`.scheduling` and :mod:`.cluster` do.
"""
