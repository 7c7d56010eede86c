"""Drives whose mount is known: is what a drive says of its mount true?

It was written from the public interface (issue 21), without a look at how the mount is estimated. Frames of
rendered and of recorded roads say how wrong frames are (:mod:`.frame_errors`). Cars drive, brake, stand and
lean on their springs (:mod:`.rides`), and frames are drawn for them (:mod:`.draws`). Their estimates are
judged (:mod:`.judged`), those of rendered drives (:mod:`.rendered`) and of recorded ones (:mod:`.recorded`).
"""
