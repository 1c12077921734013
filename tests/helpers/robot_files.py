"""A small robot, written as URDF and as MJCF: a slide and two hinges, a fixed bracket, and a finger beside the tip."""

from __future__ import annotations

URDF = """<robot name="small">
  <link name="base"><inertial><mass value="5"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="rail" type="prismatic">
    <parent link="base"/><child link="cart"/><origin xyz="0 0 0.2" rpy="0 0 1.5707963267948966"/><axis xyz="1 0 0"/>
    <limit lower="-0.3" upper="0.4" velocity="2" effort="80"/><dynamics damping="0.5"/>
  </joint>
  <link name="cart"><inertial><origin xyz="0.01 0.02 0.03" rpy="0.3 0 0"/><mass value="2"/>
    <inertia ixx="0.02" iyy="0.03" izz="0.025" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="package://nowhere/cart.dae"/></geometry></visual></link>
  <joint name="shoulder-joint" type="continuous">
    <parent link="cart"/><child link="upper"/><origin xyz="0 0.05 0.1" rpy="1.5707963267948966 0 0"/>
    <axis xyz="0 0.6 0.8"/>
    <limit velocity="3" effort="20"/>
  </joint>
  <link name="upper"><inertial><origin xyz="0 0 0.15"/><mass value="1.2"/>
    <inertia ixx="0.01" iyy="0.012" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="elbow" type="revolute">
    <parent link="upper"/><child link="fore"/><origin xyz="0 0 0.3" rpy="0 0.4 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="0" effort="0"/>
  </joint>
  <link name="fore"><inertial><origin xyz="0 0 0.1"/><mass value="0.8"/>
    <inertia ixx="0.004" iyy="0.004" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="bracket" type="fixed">
    <parent link="fore"/><child link="tool"/><origin xyz="0 0.02 0.25" rpy="0 0 0.7"/>
  </joint>
  <link name="tool"><inertial><origin xyz="0 0 0.02"/><mass value="0.1"/>
    <inertia ixx="1e-4" iyy="2e-4" izz="1.5e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="finger_joint" type="prismatic">
    <parent link="fore"/><child link="finger"/><origin xyz="0.03 0 0.2"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.05" velocity="1" effort="5"/>
  </joint>
  <link name="finger"><inertial><mass value="0.05"/>
    <inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>"""

MJCF = """<mujoco model="small">
  <compiler angle="radian"/>
  <asset><mesh name="cart" file="nowhere/cart.obj"/></asset>
  <worldbody>
    <body name="base">
      <inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/>
      <body name="cart" pos="0 0 0.2" euler="0 0 1.5707963267948966">
        <joint name="rail" type="slide" axis="1 0 0" range="-0.3 0.4" damping="0.5" actuatorfrcrange="-80 80"/>
        <inertial pos="0.01 0.02 0.03" euler="0.3 0 0" mass="2" diaginertia="0.02 0.03 0.025"/>
        <geom type="mesh" mesh="cart"/>
        <body name="upper" pos="0 0.05 0.1" euler="1.5707963267948966 0 0">
          <joint name="shoulder-joint" axis="0 0.6 0.8"/>
          <inertial pos="0 0 0.15" mass="1.2" diaginertia="0.01 0.012 0.004"/>
          <body name="fore" pos="0 0 0.3" euler="0 0.4 0">
            <joint name="elbow" axis="0 1 0" range="-2 2"/>
            <inertial pos="0 0 0.1" mass="0.8" diaginertia="0.004 0.004 0.001"/>
            <body name="tool" pos="0 0.02 0.25" euler="0 0 0.7">
              <inertial pos="0 0 0.02" mass="0.1" diaginertia="1e-4 2e-4 1.5e-4"/>
            </body>
            <body name="finger" pos="0.03 0 0.2">
              <joint name="finger_joint" type="slide" axis="1 0 0" range="0 0.05"/>
              <inertial pos="0 0 0" mass="0.05" diaginertia="1e-5 1e-5 1e-5"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder-joint" gear="2" forcerange="-10 10"/></actuator>
  <equality><joint joint1="finger_joint"/></equality>
</mujoco>"""
