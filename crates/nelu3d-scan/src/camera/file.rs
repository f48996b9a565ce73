//! Camera and projector files: the LookUp3D tools' JSON, OpenCV's FileStorage, ROS camera_info.
