"""Reinforcement learners: SAC, TD3, DDPG and PPO, the task that they learn, and its Gymnasium environment."""
