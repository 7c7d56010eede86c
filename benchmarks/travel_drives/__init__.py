"""Drives whose direction of travel is known: are the yaw and the pitch against it true?

It was written from the public interface (issue 22), without a look at how they are estimated. Roads bend,
rise and fall to a side (:mod:`.ways`); a car drives on them on its tyres and springs (:mod:`.cars`), kept in
its lane by a driver (:mod:`.driving`). Streets stand along the roads (:mod:`.streets`), and both cameras
film them (:mod:`.filming`). The drives of a series (:mod:`.kinds`) go through the calibrator, frame by frame,
and are judged (:mod:`.judged`), and so are recorded ones (:mod:`.recorded`).
"""
