"""What a node does otherwise than rospy, or without it: each module says what goes wrong, or how much is saved.

`ros.common.node` has all of it take hold before rospy.init_node.
"""
