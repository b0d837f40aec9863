"""Patches of rospy; each module says which defect it fixes, or what it saves.

`ros.common.node` applies all of them before rospy.init_node.
"""
