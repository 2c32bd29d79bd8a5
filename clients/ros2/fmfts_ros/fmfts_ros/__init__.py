"""Publishes the contacts of fmfts-daemon in ROS 2."""
