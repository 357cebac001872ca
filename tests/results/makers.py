"""All results by their names."""

from .data import Maker
from .of_experiments import experiments, time_experiments
from .of_flights import missions, scenes, studies
from .of_frames import ablations, calibration, cameras, learned, odometry, performance, real, rendered
from .of_installation import installation

MAKERS = {
    "performance": Maker(performance, times=True),
    "missions": Maker(missions, times=True),
    "installation": Maker(installation, times=True),
    "experiments": Maker(experiments, before=time_experiments),
    **{
        make.__name__: Maker(make)
        for make in (real, learned, ablations, calibration, rendered, odometry, cameras, scenes, studies)
    },
}
