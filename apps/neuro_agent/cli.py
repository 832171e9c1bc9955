"""Teach an agent of spiking neurons by reward, in any Gymnasium environment."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from neuro.apps import Backend, Chips, Seed, Set, Sources, assignments, at_least, seeds

app = typer.Typer(
    name="agent", help=__doc__, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)


Environment = Annotated[
    str,
    typer.Argument(metavar="ENV", help="An id of gymnasium, module:Id-v0, or module:Class of a file of yours."),
]
MaybeEnvironment = Annotated[
    str | None,
    typer.Argument(metavar="ENV", help="Another environment than that of the training.", show_default=False),
]
AgentFile = Annotated[Path, typer.Argument(metavar="FILE", help="An agent, as 'train' writes it.")]
Episodes = Annotated[int, typer.Option("--episodes", metavar="N", parser=at_least(1), help="Episodes of each test.")]
Steps = Annotated[int, typer.Option("--steps", metavar="N", parser=at_least(1), help="Control steps of each training.")]
Json = Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")]


@app.command()
def train(
    environment: Environment,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The agent to write.")],
    until: Annotated[
        float | None,
        typer.Option(metavar="R", help="Mean return of 100 episodes to stop at.", show_default="what ENV asks for"),
    ] = None,
    steps: Annotated[
        int | None, typer.Option("--steps", metavar="N", parser=at_least(1), help="Control steps at most.")
    ] = None,
    episodes: Annotated[
        int | None, typer.Option("--episodes", metavar="N", parser=at_least(1), help="Episodes at most.")
    ] = None,
    seed: Seed = 0,
    envs: Annotated[
        int,
        typer.Option("--envs", metavar="N", parser=at_least(1), help="Environments side by side, each with a network."),
    ] = 1,
    save: Annotated[
        Path | None,
        typer.Option("--save", metavar="NET", help="Also write the untrained network with its world."),
    ] = None,
    set: Set = [],  # noqa: B006
) -> None:
    """Train an agent and write it to a file; after a kill the same command goes on from the last checkpoint.

    --set changes a setting: --set fields=8 --set decay=0.8.
    """
    from neuro_agent import ActorCritic, environments
    from neuro_agent.training import BLOCK

    settings = assignments(set)
    bar = environments.bar_of(environment) if until is None else until
    if bar is None and steps is None and episodes is None:
        message = f"'{environment}' names no return to reach: expected --until, --steps or --episodes"
        raise typer.BadParameter(message, param_hint="'--until'")
    env = environments.make_many(environment, envs)
    one: Any = env if envs == 1 else environments.make(environment)
    agent = ActorCritic(one.observation_space, one.action_space, seed=seed, **settings)
    if save is not None:
        agent.network(one).save(save)
    try:
        log = agent.train(env, bar, steps=steps, episodes=episodes, progress=True, out=out)
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
    """Test an agent with frozen weights in episodes that it has not seen."""
    from neuro_agent import ActorCritic, environments, report

    agent = ActorCritic.load(file)
    name = _environment(file, environment)
    tried = agent.test(environments.make(name), episodes, seed=seed, backend=backend)
    bar = environments.bar_of(name)
    if json:
        typer.echo(report.as_json(tried, {"environment": name, "seed": seed, "backend": backend, "bar": bar}))
    else:
        typer.echo(f"{name}: {report.told(tried)}" + ("" if bar is None else f"; it counts as solved at {bar:g}"))


@app.command()
def controls(
    environment: Environment,
    steps: Steps = 20_000,
    episodes: Episodes = 100,
    seed: Seed = 0,
    set: Set = [],  # noqa: B006
) -> None:
    """Train the agent, and agents that are kept from learning, which must fail; print the table."""
    from neuro_agent import ActorCritic, environments, report

    env = environments.make(environment)
    agent = ActorCritic(env.observation_space, env.action_space, seed=seed, **assignments(set))
    agent.train(env, steps=steps, progress=True)
    found = {"agent": agent.test(env, episodes)} | agent.controls(env, steps=steps, episodes=episodes)
    report.show_controls(found, f"{environment}, {steps:,} steps each, seed {seed}")


@app.command()
def watch(
    file: AgentFile,
    environment: MaybeEnvironment = None,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The page to write.")] = Path("episode.html"),
    seed: Seed = 0,
    learning: Annotated[bool, typer.Option("--learning", help="Go on learning in this episode.")] = False,
) -> None:
    """Write an episode as one page for a browser: frames, spikes, value, error, return and weights."""
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
        Any, typer.Option("--seeds", metavar="A,B,...", parser=seeds, help="Seeds; each is a training of each.")
    ] = "1,2,3",
    episodes: Episodes = 100,
    out: Annotated[Path | None, typer.Option("--out", metavar="FILE", help="All figures as JSON.")] = None,
    method: Annotated[
        list[str],
        typer.Option("--method", metavar="NAME", help="Only this: agent, twin, ppo, dqn or random; repeatable."),
    ] = [],  # noqa: B006
    set: Set = [],  # noqa: B006
) -> None:
    """Train the agent, its linear twin, PPO and DQN for the same steps, test them frozen, and print who wins.

    --set changes the agent's settings; PPO and DQN, of stable-baselines3, have their defaults.
    """
    from neuro.apps import Bar
    from neuro_agent import compare as comparing, report

    plan = comparing.Plan(environment, steps, seeds, episodes, assignments(set), tuple(method))
    if out is not None:
        report.check_table(out)
    with Bar() as bar:
        done: list[str] = []

        def tell(text: str) -> None:
            done.append(text)
            bar.show(len(done), len(plan.trials), text)

        found = comparing.run(plan, tell)
    if out is not None:
        report.write_table(found, out)
    report.show_comparison(found)


@app.command()
def energy(
    environment: Environment,
    until: Annotated[
        float | None,
        typer.Option(
            "--until", metavar="R", help="Mean return of 100 episodes to stop at.", show_default="as ENV asks"
        ),
    ] = None,
    steps: Steps = 150_000,
    method: Annotated[str, typer.Option("--method", metavar="NAME", help="The deep agent: ppo or dqn.")] = "ppo",
    chips: Chips = "cpu,gpu,arm",
    seed: Seed = 0,
    sources: Sources = False,
    json: Json = False,
) -> None:
    """Train PPO or DQN and print the joules of its training on processors, beside 'neuro energy NET --until R'."""
    from json import dumps

    from neuro.apps import argument, print_bills, unknown
    from neuro.chips import dense
    from neuro_agent import compare, deep, environments

    if until is not None:
        argument("--until", until)
    if method not in deep.NAMES:
        raise unknown("deep agent", method, deep.NAMES)
    compare.Plan(environment, steps, (seed,), only=(method,))  # refuses what cannot be trained
    for each in chips:
        dense({}, each)  # what cannot be priced is reported before the training
    env, bar = environments.make(environment), environments.bar_of(environment) if until is None else until
    model, log, macs = deep.trained(method, deep.from_zero(env), steps=steps, seed=seed, until=bar)
    taken = model.num_timesteps
    bills = [dense(macs, each, steps=taken, of="training", notes=deep.NOTES) for each in chips]
    if json:
        about = {"method": method, "seed": seed, "episodes": len(log), "steps": taken, "solved": log.solved}
        typer.echo(dumps({**about, "bills": [bill.as_dict() for bill in bills]}, indent=1))
    else:
        if bar is not None and not log.solved:
            typer.echo(f"the goal is not reached: joules of {taken:,} steps")
        print_bills(bills, sources)
        typer.echo(f"{method}: {str(log).removeprefix('Log(').removesuffix(')')}")


def _environment(file: Path, chosen: str | None) -> str:
    """The environment that the user names, or that in which an agent was trained."""
    from neuro import ModelError
    from neuro_agent import environments

    name = chosen or environments.remembered(file)
    if chosen is None:
        environments.check_remembered(file, name)
    if not name:
        raise ModelError(f"{file}: does not say in which environment it was trained: expected ENV behind the file")
    return name
