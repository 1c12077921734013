"""Learners that find strikes: SAC, TD3, DDPG and PPO, the task they learn, and its Gymnasium environment."""
