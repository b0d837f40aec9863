"""Navigation: executions of planners, controllers and recoveries, and the move_base state machine over them.

All of it is advanced by calls of `update(now)`; none of it starts a thread but `worker.ThreadWorker`.
"""
