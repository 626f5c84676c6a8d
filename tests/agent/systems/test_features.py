import torch

from agent.systems.features import TokenCache


def frames(count, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.randint(0, 256, (count, 16, 16, 3), generator=generator, dtype=torch.uint8)


def test_tokens_are_those_of_the_mae(tiny_mae):
    cache, rgb = TokenCache(tiny_mae, 1), frames(5)
    torch.testing.assert_close(cache.encode(rgb), tiny_mae.encode(rgb), atol=2e-3, rtol=1e-3)


def test_a_frame_is_encoded_once(tiny_mae, monkeypatch):
    cache, calls, encode = TokenCache(tiny_mae, 1), [], tiny_mae.encode
    monkeypatch.setattr(tiny_mae, "encode", lambda rgb: calls.append(len(rgb)) or encode(rgb))
    first = cache.encode(frames(3))
    again = cache.encode(frames(3).flip(0))
    assert calls == [1, 1, 1]
    assert torch.equal(first, again.flip(0))


def test_tokens_do_not_depend_on_the_company(tiny_mae):
    together = TokenCache(tiny_mae, 1).encode(frames(4))
    alone = torch.cat([TokenCache(tiny_mae, 1).encode(frame[None]) for frame in frames(4)])
    assert torch.equal(together, alone)


def test_memory_is_limited_and_forgets_the_oldest(tiny_mae):
    cache = TokenCache(tiny_mae, 1)
    cache.capacity = 3
    rgb = frames(5)
    kept = cache.encode(rgb)
    assert cache.num_frames == 3
    assert torch.equal(cache.encode(rgb), kept)


def test_tokens_are_the_same_under_autocast(tiny_mae):
    plain = TokenCache(tiny_mae, 1).encode(frames(2))
    with torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(TokenCache(tiny_mae, 1).encode(frames(2)), plain)
