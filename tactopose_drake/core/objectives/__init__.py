"""Objectives: each scores a batch of poses; they add up."""
