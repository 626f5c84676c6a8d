import dataclasses

import pytest

from agent.config import AgentConfig
from langwm_data.config_io import ConfigError, load_config, preset_names


def load(name):
    return load_config(AgentConfig, "agent", presets=[name])


def test_presets_are_these():
    assert preset_names("agent") == ["debug", "dreamerv3", "grid", "homes", "paper", "tiny"]


@pytest.mark.parametrize("name", ["debug", "dreamerv3", "grid", "homes", "paper", "tiny"])
def test_preset_loads(name):
    assert load(name).system == "langwm"


def test_paper_preset_equals_table_3():
    config = load("paper")
    pooling, rssm, behavior = config.world_model.pooling, config.world_model.rssm, config.behavior
    assert (pooling.dim, pooling.num_heads, pooling.mlp_ratio, pooling.num_layers) == (256, 4, 4, 2)
    assert (pooling.norm_eps, pooling.dropout) == (1e-6, 0.1)
    assert (rssm.num_latents, rssm.num_classes, rssm.deter) == (32, 32, 1024)
    assert (config.world_model.loss_scales.kl, config.world_model.learning_rate) == (1.0, 3e-4)
    assert (behavior.imag_horizon, behavior.slow_critic_every) == (15, 100)
    assert (behavior.actor_learning_rate, behavior.critic_learning_rate) == (1e-4, 1e-4)
    for net in (config.world_model.head, behavior.actor, behavior.critic):
        assert (net.layers, net.units) == (4, 400)
    assert (config.optimizer.eps, config.optimizer.grad_clip) == (1e-5, 100.0)
    assert (config.world_model.task.layers, config.world_model.task.units) == (4, 256)
    assert (config.update_every, config.steps, config.replay.capacity_steps) == (5, 100_000, 300_000)


def test_paper_preset_is_the_default_but_for_the_literal_reward_loss():
    paper, default = load("paper"), AgentConfig()
    assert paper.finetune.model == dataclasses.replace(default.finetune.model, reward_loss="mse")
    finetune = dataclasses.replace(paper.finetune, model=default.finetune.model)
    assert dataclasses.replace(paper, finetune=finetune) == default


def test_dreamerv3_is_what_it_adds_and_off_without_the_preset():
    on, off = load("dreamerv3"), AgentConfig()
    assert on.world_model.rssm.unimix == 0.01
    assert (on.world_model.reward_transform, on.behavior.value_transform) == ("twohot", "twohot")
    assert on.behavior.return_scale == "percentile"
    assert (off.world_model.rssm.unimix, off.behavior.return_scale) == (0.0, "none")
    assert (off.world_model.reward_transform, off.behavior.value_transform) == ("symlog", "identity")


def test_paper_rewards_as_igibson_does_and_homes_pays_progress_more():
    paper, homes = load("paper").env.reward, load("homes").env.reward
    assert (paper.progress, paper.collision, paper.success) == (1.0, -0.1, 10.0)
    assert dataclasses.replace(homes, progress=1.0) == paper
    # Five centimetres towards the goal, touching something, still pay.
    assert homes.progress * 0.05 + homes.collision > 0 > paper.progress * 0.05 + paper.collision


def test_tiny_keeps_the_papers_latents():
    rssm = load("tiny").world_model.rssm
    assert (rssm.num_latents, rssm.num_classes) == (32, 32)


def test_grid_learns_near_goals_and_is_scored_on_far_ones_too():
    config = load("grid")
    env, mae = config.env, config.finetune.model
    assert (env.camera.height, env.camera.width) == (mae.height, mae.width) == (64, 80)
    assert (env.distance_edges_m, env.drawn_tiers) == ((1.0, 3.0, 6.0), 1)
    assert (config.steps, config.eval_episodes) == (10_000, 200)
    farthest_m, metres_per_step = env.distance_edges_m[-1], env.max_linear_m_s * env.step_s
    assert env.max_steps > 1.5 * farthest_m / metres_per_step
    assert config.steps % config.checkpoint_every == 0


def test_schedule_that_needs_a_last_step_is_refused():
    with pytest.raises(ConfigError, match=r"finetune.optimizer.schedule 'cosine' must be 'constant'"):
        load_config(AgentConfig, "agent", assignments=["finetune.optimizer.schedule=cosine"])


def test_heads_that_do_not_divide_the_width_are_refused():
    with pytest.raises(ConfigError, match=r"pooling.*30.*multiple of num_heads 4"):
        load_config(AgentConfig, "agent", assignments=["world_model.pooling.dim=30"])
