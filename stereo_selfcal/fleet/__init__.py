"""Many recordings on many processes: one task a recording, or a stretch of a long one.

Workers are processes of this machine (:mod:`.processes`) or those of a Dask cluster (:mod:`.cluster`, the
only module that needs Dask). What they do is in :mod:`.work`, and who does what in :mod:`.scheduling`.
"""
