"""ROS 2 nodes; the only place that imports rclpy."""

import os

# matrices here are small: threads of a linear algebra library would only fight the trainer for the cores
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
