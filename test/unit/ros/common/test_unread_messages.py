"""Messages nobody looks into arrive as they were sent, and can be looked into."""

import io

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rospy.msg import serialize_message

from mbf_relay.ros.common.unread import unread


def written(message):
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def test_a_plan_that_is_passed_on_unread_is_shown_to_the_last_bit_and_can_be_read():
    plan = Path(poses=[PoseStamped(), PoseStamped()])
    plan.header.frame_id, plan.header.seq, plan.poses[1].pose.position.x = "map", 7, 0.1
    came = unread(Path)().deserialize(memoryview(written(plan)))
    sent = io.BytesIO()
    serialize_message(sent, 42, came)  # as rospy does, which numbers what has a header
    assert sent.getvalue()[4:] == written(plan) and came.read() == plan
    assert (came._type, came._md5sum) == (Path._type, Path._md5sum)
