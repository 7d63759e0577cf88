"""The belief of an object's pose over time: predicted from motion, updated by touch and vision."""
