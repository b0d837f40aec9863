# What scripts/run installs, which reads this file: packages of Debian 12 or of Ubuntu 20.04 with ROS Noetic, and, with
# their hashes, from PyPI what neither has.

debian_packages=(  # to build with, and to test without a screen
  catkin cmake g++ libactionlib-dev libactionlib-msgs-dev libdynamic-reconfigure-config-init-mutex-dev
  libgeometry-msgs-dev libnav-msgs-dev librostest-dev libstd-msgs-dev make python3-catkin-pkg python3-dev python3-empy
  python3-hypothesis python3-numba python3-pip python3-pytest python3-rosmsg python3-rosnode python3-rosparam
  python3-rosservice python3-rostest python3-rostopic python3-setuptools python3-venv ros-message-generation
  ros-message-runtime
)
debian_node_packages=(  # to run, once it is built
  python3-actionlib python3-defusedxml python3-diagnostic-msgs python3-distributed python3-dynamic-reconfigure
  python3-geometry-msgs python3-map-msgs python3-matplotlib python3-move-base-msgs python3-nav-msgs python3-numpy
  python3-pil python3-psutil python3-rosbag python3-rosgraph-msgs python3-roslaunch python3-rospy python3-scipy
  python3-sensor-msgs python3-std-msgs python3-std-srvs python3-tf2-msgs python3-tf2-ros python3-tornado
  python3-trajectory-msgs python3-visualization-msgs python3-yaml ros-actionlib-msgs ros-geometry-msgs ros-nav-msgs
  ros-robot-state-publisher ros-std-msgs rosbash rosout rospack-tools
)
debian_package_packages=(build-essential debhelper dh-python fakeroot lintian)
noetic_packages=(
  build-essential cmake python3-defusedxml python3-dev python3-distributed python3-hypothesis python3-matplotlib
  python3-numba python3-numpy python3-pip python3-pil python3-psutil python3-pytest python3-scipy python3-setuptools
  python3-tornado python3-venv python3-yaml
  ros-noetic-{actionlib,catkin,diagnostic-msgs,dynamic-reconfigure,geometry-msgs,map-msgs,mbf-msgs,message-generation}
  ros-noetic-{message-runtime,move-base-msgs,nav-msgs,robot-state-publisher,rosbag,rosbash,roslaunch,rosmsg,rosnode}
  ros-noetic-{rosparam,rospack,rospy,rosservice,rostest,rostopic,sensor-msgs,std-srvs,tf2-msgs,tf2-ros,trajectory-msgs}
  ros-noetic-{rosgraph-msgs,rosout,visualization-msgs}
)
compiler_packages=(python3-numba python3-numpy)  # of kernels, which needs nothing else; so these come first
test_packages=(imagemagick libgl1-mesa-dri xdotool xvfb)
browser_packages=(chromium chromium-driver python3-selenium)  # for tests, where a browser is a package at all

# From PyPI comes only what is known by its hash: a package, its version, and each of its files that may be taken, the
# source among them for machines without a wheel. Whoever adds one adds what it needs in turn; pip looks for nothing else.
pybullet_files=(  # 3.2.7 for Python 3.8, 3.9, 3.10 and 3.11 on x86_64, then its source
  637be83db2405d4f058a1125bd56bc954f355ff15e519a6738c00d4be3741c4e
  438a95e9d53af5b2e9bbf7b12e1846485e58532b57580c5290dee305fa8b4a6b
  814e6b0c035a634b5c46f69065effb085cc451886dda4140576be2f34b461940
  5d858abf7c12a21ef3ed351cf81dac1b5e486ec25c9ab59bfc84beb89034edff
  042879db8d101ac7590dee475fc6aded508b85fe1273fdbbfde1d88bd200e14f
)
pybullet_files_for_noetic=(  # 3.2.5 for Python 3.8 on x86_64, then its source
  3f9c4289f1773b55915f4efb7514b088539d59b4a082465d68ee7caac11355d1
  1bcb9afb87a086be1b2de18f084d1fdab8194da1bf71f264743ca26baa39c351
)
pip_packages=("pybullet==3.2.7 ${pybullet_files[*]/#/--hash=sha256:}")
test_pip_packages=()
test_pip_packages_for_debian=(  # pyarrow for Python 3.11 on x86_64, then on aarch64
  "gymnasium==0.29.1 --hash=sha256:61c3384b5575985bb7f85e43213bcb40f36fcdff388cae6bc229304c71f2843e"
  "farama-notifications==0.0.4 --hash=sha256:14de931035a41961f7c056361dc7f980762a143d05791ef5794a751a2caf05ae"
  "pyarrow==14.0.2 --hash=sha256:06ff1264fe4448e8d02073f5ce45a9f934c0f3db0a04460d0b01ff28befc3696 \
--hash=sha256:3f16111f9ab27e60b391c5f6d197510e3ad6654e73857b4e394861fc79c37200"
)

# Choose by the variables of scripts/run: system, processor, for_tests and for_package.
choose_packages() {
  case $system in
    debian-12)
      packages=("${debian_packages[@]}" "${debian_node_packages[@]}"); viewer=rviz
      test_packages+=("${browser_packages[@]}" python3-optuna python3-typing-extensions)
      test_pip_packages=("${test_pip_packages_for_debian[@]}") ;;  # want a newer NumPy than Ubuntu 20.04's
    ubuntu-20.04)
      packages=("${noetic_packages[@]}"); viewer=ros-noetic-rviz
      # later ones are made for a newer NumPy than the system's 1.17
      pip_packages=("pybullet==3.2.5 ${pybullet_files_for_noetic[*]/#/--hash=sha256:}") ;;
    *) fail "this is $system; these scripts know Debian 12 and Ubuntu 20.04. Else use a catkin workspace (README.md)." ;;
  esac
  [ $processor = x86_64 ] || packages+=(g++ python3-wheel)  # elsewhere PyBullet has to be compiled
  if [ $for_tests = yes ]; then packages+=("${test_packages[@]}"); fi
  if [ $for_package = yes ]; then
    [ "$viewer" = rviz ] || fail "packages are built on Debian 12 alone; this is $system"
    packages+=("${debian_package_packages[@]}")
    viewer=()
  fi
  if [ $for_tests = yes ] || [ -n "${DISPLAY:-}${WAYLAND_DISPLAY:-}" ]; then packages+=("${viewer[@]}"); fi
}
