"""The replay buffer."""

from __future__ import annotations

import torch

from whiptool.rl.replay import ReplayBuffer, Transitions


def test_replay_overwrites_the_oldest():
    buffer = ReplayBuffer(5, 1, 1)

    def add(*numbers):
        x = torch.tensor(numbers, dtype=torch.float32)
        buffer.add(Transitions(x[:, None], x[:, None], x, x[:, None], x > 4))

    add(1, 2, 3)
    assert set(buffer.sample(200, torch.Generator().manual_seed(0)).reward.tolist()) == {1, 2, 3}
    add(4, 5, 6, 7)
    assert buffer.size == 5
    drawn = buffer.sample(500, torch.Generator().manual_seed(0))
    assert set(drawn.reward.tolist()) == {3, 4, 5, 6, 7}
    assert torch.equal(drawn.obs[:, 0], drawn.reward)
    assert torch.equal(drawn.terminated, (drawn.reward > 4).float())
    other = ReplayBuffer(5, 1, 1)
    other.load_state_dict(buffer.state_dict())
    for each in (buffer, other):
        each.add(Transitions(**{name: array[:3] for name, array in vars(drawn).items()}))
    assert all(
        torch.equal(*map(torch.as_tensor, pair))
        for pair in zip(buffer.state_dict().values(), other.state_dict().values())
    )


def test_the_oldest_is_the_next_to_go():
    buffer = ReplayBuffer(4, 2, 1)

    def held():
        return buffer.state_dict()["reward"].tolist()

    def add(*numbers):
        x = torch.tensor(numbers)
        buffer.add(Transitions(x[:, None].expand(-1, 2), x[:, None], x, -x[:, None].expand(-1, 2), torch.zeros(len(x))))

    add(1.0, 2.0, 3.0)
    assert (held(), buffer.size) == ([1, 2, 3], 3)
    add(4.0, 5.0, 6.0)
    assert (held(), buffer.size) == ([5, 6, 3, 4], 4)
    add(7.0)
    assert held() == [5, 6, 7, 4]
    drawn = buffer.sample(4000, torch.Generator().manual_seed(0))
    counts = torch.bincount(drawn.reward.int(), minlength=8)[4:]
    assert (counts > 850).all()  # uniform, with replacement
    assert torch.equal(drawn.next_obs, -drawn.obs)
    assert drawn.obs.shape == (4000, 2)
