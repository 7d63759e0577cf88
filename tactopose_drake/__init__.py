"""Touch-based pose estimation of grasped objects, as systems for Drake."""
