"""Train a spiking agent by reward, in any Gymnasium environment."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from neuro.apps import Backend, Chips, Seed, Sources, assignments, at_least, input_file, seeds

app = typer.Typer(
    name="agent", help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)


Environment = Annotated[
    str,
    typer.Argument(metavar="ENV", help="Environment: a gymnasium id, module:Id-v0, or module:Class."),
]
MaybeEnvironment = Annotated[
    str | None,
    typer.Argument(metavar="ENV", help="Environment.", show_default="that of the training"),
]
AgentFile = Annotated[
    Path,
    typer.Argument(metavar="FILE", callback=input_file("a neuro agent 1"), help="Agent file from 'neuro agent train'."),
]
Episodes = Annotated[int, typer.Option("--episodes", metavar="N", parser=at_least(1), help="Episodes per test.")]
Steps = Annotated[int, typer.Option("--steps", metavar="N", parser=at_least(1), help="Control steps per training.")]
Set = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Setting of the agent, e.g. fields=8 or decay=0.8; repeatable.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")]


@app.command()
def train(
    environment: Environment,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Agent file to write.")],
    until: Annotated[
        float | None,
        typer.Option(
            metavar="R", help="Goal: mean return of 100 episodes; then stop.", show_default="ENV's reward threshold"
        ),
    ] = None,
    steps: Annotated[
        int | None, typer.Option("--steps", metavar="N", parser=at_least(1), help="Maximum number of control steps.")
    ] = None,
    episodes: Annotated[
        int | None, typer.Option("--episodes", metavar="N", parser=at_least(1), help="Maximum number of episodes.")
    ] = None,
    seed: Seed = 0,
    envs: Annotated[
        int,
        typer.Option(
            "--envs",
            metavar="N",
            parser=at_least(1),
            help="Environments side by side, each with a copy of the network; their weight changes are summed.",
        ),
    ] = 1,
    save: Annotated[
        Path | None,
        typer.Option("--save", metavar="NET", help="File for 'neuro run': the untrained network with its world."),
    ] = None,
    set: Set = [],  # noqa: B006
) -> None:
    """Train an agent and write it to a file. Run the same command again to resume from the last checkpoint."""
    from neuro_agent import ActorCritic, environments
    from neuro_agent.training import BLOCK

    settings = assignments(set)
    goal = environments.bar_of(environment) if until is None else until
    if goal is None and steps is None and episodes is None:
        message = f"'{environment}' has no reward threshold: expected --until, --steps or --episodes"
        raise typer.BadParameter(message, param_hint="'--until'")
    env = environments.make_many(environment, envs)
    single_env: Any = env if envs == 1 else environments.make(environment)
    agent = ActorCritic(single_env.observation_space, single_env.action_space, seed=seed, **settings)
    if save is not None:
        agent.network(single_env).save(save)
    try:
        log = agent.train(env, goal, steps=steps, episodes=episodes, progress=True, out=out)
    except KeyboardInterrupt:
        if out.with_name(f"{out.name}.training").exists():
            message = "Interrupted. Run the same command again to resume from the last checkpoint."
        else:
            message = f"Interrupted before the first checkpoint ({BLOCK * envs:,} steps). Nothing was kept."
        typer.echo(message, err=True)
        raise typer.Exit(130) from None
    environments.remember(out, environment)
    typer.echo(f"{out}: {str(log).removeprefix('Log(').removesuffix(')')}")


@app.command("test")
def try_agent(
    file: AgentFile,
    environment: MaybeEnvironment = None,
    episodes: Episodes = 100,
    seed: Seed = 0,
    backend: Backend = "event",
    json: Json = False,
) -> None:
    """Test an agent with frozen weights in new episodes."""
    from neuro_agent import ActorCritic, environments, report

    agent = ActorCritic.load(file)
    name = _environment(file, environment)
    result = agent.test(environments.make(name), episodes, seed=seed, backend=backend)
    goal = environments.bar_of(name)
    if json:
        typer.echo(report.as_json(result, {"environment": name, "seed": seed, "backend": backend, "bar": goal}))
    else:
        typer.echo(f"{name}: {report.summary(result)}" + ("" if goal is None else f"; it counts as solved at {goal:g}"))


@app.command()
def controls(
    environment: Environment,
    steps: Steps = 20_000,
    episodes: Episodes = 100,
    seed: Seed = 0,
    set: Set = [],  # noqa: B006
) -> None:
    """Train an agent, and agents that cannot learn, which should fail; print a table of their returns."""
    from neuro_agent import ActorCritic, environments, report

    env = environments.make(environment)
    agent = ActorCritic(env.observation_space, env.action_space, seed=seed, **assignments(set))
    agent.train(env, steps=steps, progress=True)
    results = {"agent": agent.test(env, episodes)} | agent.controls(env, steps=steps, episodes=episodes)
    report.show_controls(results, f"{environment}, {steps:,} steps each, seed {seed}")


@app.command()
def watch(
    file: AgentFile,
    environment: MaybeEnvironment = None,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="HTML page to write.")] = Path("episode.html"),
    seed: Seed = 0,
    learning: Annotated[bool, typer.Option("--learning", help="Continue learning in this episode.")] = False,
) -> None:
    """Write an episode as an HTML page: frames, spikes, value, error, return and weights."""
    from neuro_agent import ActorCritic, environments
    from neuro_agent.watch import watch as write

    agent = ActorCritic.load(file)
    env = environments.make(_environment(file, environment), frames=True)
    typer.echo(f"{out}: {write(agent, env, out, seed, learning=learning)}")


@app.command()
def compare(
    environment: Environment,
    steps: Steps,
    seeds: Annotated[
        Any, typer.Option("--seeds", metavar="A,B,...", parser=seeds, help="Seeds; each method is trained with each.")
    ] = "1,2,3",
    episodes: Episodes = 100,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="JSON file for all results.")] = None,
    method: Annotated[
        list[str],
        typer.Option("--method", metavar="NAME", help="Method: agent, twin, ppo, dqn or random; repeatable."),
    ] = [],  # noqa: B006
    set: Set = [],  # noqa: B006
) -> None:
    """Compare the agent, its linear twin, PPO and DQN, trained for the same number of steps and tested frozen.

    --set is for the agent; PPO and DQN have the defaults of stable-baselines3.
    """
    from neuro.apps import Bar
    from neuro_agent import compare as comparing, report

    plan = comparing.Plan(environment, steps, seeds, episodes, assignments(set), tuple(method))
    if out is not None:
        report.check_table(out)
    with Bar() as bar:
        finished: list[str] = []

        def show_trial(text: str) -> None:
            finished.append(text)
            bar.show(len(finished), len(plan.trials), text)

        comparison = comparing.run(plan, show_trial)
    if out is not None:
        report.write_table(comparison, out)
    report.show_comparison(comparison)


@app.command()
def energy(
    environment: Environment,
    until: Annotated[
        float | None,
        typer.Option(
            "--until",
            metavar="R",
            help="Goal: mean return of 100 episodes; then stop.",
            show_default="ENV's reward threshold",
        ),
    ] = None,
    steps: Steps = 150_000,
    method: Annotated[str, typer.Option("--method", metavar="NAME", help="Deep agent: ppo or dqn.")] = "ppo",
    chips: Chips = "cpu,gpu,arm",
    seed: Seed = 0,
    sources: Sources = False,
    json: Json = False,
) -> None:
    """Train PPO or DQN and print the energy of the training on processors, as 'neuro energy NET --until R' does."""
    from json import dumps

    from neuro.apps import argument, print_bills, unknown
    from neuro.chips import dense
    from neuro_agent import compare, deep, environments

    if until is not None:
        argument("--until", until)
    if method not in deep.NAMES:
        raise unknown("deep agent", method, deep.NAMES)
    compare.Plan(environment, steps, (seed,), only=(method,))  # refuses untrainable environments before the training
    for target in chips:
        dense({}, target)  # refuses chips without prices before the training
    env, goal = environments.make(environment), environments.bar_of(environment) if until is None else until
    model, log, macs = deep.trained(method, deep.from_zero(env), steps=steps, seed=seed, until=goal)
    n_steps = model.num_timesteps
    bills = [dense(macs, target, steps=n_steps, of="training", notes=deep.NOTES) for target in chips]
    if json:
        facts = {"method": method, "seed": seed, "episodes": len(log), "steps": n_steps, "solved": log.solved}
        typer.echo(dumps({**facts, "bills": [bill.as_dict() for bill in bills]}, indent=1))
    else:
        if goal is not None and not log.solved:
            typer.echo(f"Goal not reached: energy of {n_steps:,} steps")
        print_bills(bills, sources)
        typer.echo(f"{method}: {str(log).removeprefix('Log(').removesuffix(')')}")


def _environment(file: Path, chosen: str | None) -> str:
    """Return the environment that the user names, or else that of the agent's training."""
    from neuro import ModelError
    from neuro_agent import environments

    name = chosen or environments.remembered(file)
    if chosen is None:
        environments.check_remembered(file, name)
    if not name:
        raise ModelError(f"{file}: names no environment: expected ENV after the file")
    return name
