"""Navigation: executions of planners, controllers and recoveries, and the move_base logic over them.

Stepped, no threads.
"""
