"""Readers of recordings that are folders of files or a video: numbered images and clouds, KITTI, EuRoC, intrinsics."""
