"""Simulated drives: CANopen nodes with the profile CiA 402, motors with dynamics, and faults on demand."""
