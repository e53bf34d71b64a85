"""What a cardiologist reads off a model: volumes, ejection fraction, wall, strain, twist, segments.

    frame          the model at one time of the cycle
    ED, ES         end diastole and end systole: the frames of the largest and the smallest volume
    base           the plane at the mitral valve, beyond which nothing counts (`base.py`, `axis.base_planes`)
    long axis      from the apex of the cavity to the centre of the base (`axis.py`)
    material       of points before deformation: the same tissue in all frames, if these share the undeformed space
    wall           the space between endocardium and epicardium, as lines from one to the other (`wall.py`)
    depth          position on such a line, from 0 (endocardium) to 1 (epicardium)
    observed       determined by the data; otherwise the prior, the smoothness of the model, determines the number

`measure.measure`: `heart_cycle.py` checks the models, `volumes.py` gives volumes below the base. Contours in long-axis
planes give the longitudinal strain. `wall_rows.py` measures the wall by `wall.py`, `wall_motion.py` (strain),
`twist.py` and `aha_segments.py`; `measures_table.py` holds the result.

The points of a ventricle that a model is fitted to come from images by `imaging/ventricle.py`.
"""
