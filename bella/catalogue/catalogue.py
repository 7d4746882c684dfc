"""The catalogue as its callers see it: one class, whose methods are short transactions."""

from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import AbstractContextManager
from datetime import date, datetime
from types import TracebackType
from typing import Any, Self

from sqlalchemy import Engine, text

from bella.catalogue import (
    alerts,
    days,
    leases,
    preference,
    publication,
    queries,
    retraction,
    schema,
    solutions,
    submissions,
    tokens,
    webhooks,
)
from bella.catalogue.engine import State, connect, display_name, parse_url, reading, snapshot
from bella.catalogue.events import PublishedEvents
from bella.catalogue.kept import Kept
from bella.catalogue.operation import Operation
from bella.catalogue.records import (
    BurstPage,
    BurstQuery,
    BurstSummary,
    DayPage,
    Delivery,
    Detection,
    DetectionPage,
    DetectionQuery,
    Held,
    Localisation,
    PointPage,
    Publication,
    SearchedDay,
    Series,
    Solution,
    SolutionPage,
    SolutionQuery,
    SourceFile,
    SourcePage,
    SourceQuery,
    StageRun,
    StoredGroup,
    Submission,
    Token,
    Webhook,
)
from bella.records import ANNOUNCED_ORIGINS, REAL_ORIGINS, Alert, JointTrack, Origin, Track


class Catalogue:
    """Bursts, versioned solutions, leases and submissions in SQLite or PostgreSQL.

    Make one with `Catalogue.open`. It may be used from several threads. Any method raises BusyError where the database
    is locked for too long, UnreachableError where it does not answer, and StoreError where it is damaged.

    Attributes
    ----------
    name : str
        Name of the database for messages, without its password.
    events : PublishedEvents
        Events that others published, and which belong to a burst.
    operation : Operation
        Tables about the service itself: freshness, latencies, mock bursts, observability.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._state = State(engine)
        self._summaries: queries.Summaries = Kept(queries.MOST_SUMMARIES)
        self._joints: solutions.Joints = Kept(solutions.MOST_JOINTS)
        self.name = display_name(engine.url)
        self.operation = Operation(engine)
        self.events = PublishedEvents(engine)

    @classmethod
    def open(cls, database_url: str, *, create: bool = False) -> Self:
        """Open a catalogue.

        Parameters
        ----------
        database_url : str
            SQLAlchemy URL of a SQLite file or a PostgreSQL database.
        create : bool
            True to make the schema in an empty database, and to bring an older one to the newest revision.

        Returns
        -------
        Catalogue
            At the newest revision.

        Raises
        ------
        InputError
            Where the URL is not one.
        StoreError
            Where the database is damaged, belongs to something else or was written by a newer version, and, unless
            `create`, where it is empty, older or missing. Nothing is overwritten.
        UnreachableError
            Where the server does not answer.
        """
        engine = connect(parse_url(database_url))
        try:
            schema.prepare(engine, create=create)
        except BaseException:
            engine.dispose()
            raise
        return cls(engine)

    def close(self) -> None:
        """Close all connections; the catalogue may be used again afterwards."""
        self._state.close()
        self._engine.dispose()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def ping(self) -> None:
        """Ask the database for an answer.

        Raises
        ------
        UnreachableError
            Where it gives none.
        """
        with reading(self._engine) as connection:
            connection.execute(text("SELECT count(*) FROM stage_run WHERE stage_run_id < 0"))

    def snapshot(self) -> AbstractContextManager[None]:
        """Let everything that is read in a block, and in this thread, come from one moment; others may write."""
        return snapshot(self._engine)

    def state(self) -> str:
        """Text that changes whenever somebody commits; see `engine.State`."""
        return self._state.now()

    def revision(self) -> str:
        """Revision of the schema, such as "0001"."""
        with reading(self._engine) as connection:
            return schema.revision_of(connection) or ""

    def lease(self, stage: str, subject: str, run_id: str, duration_s: float) -> AbstractContextManager[leases.Lease]:
        """Hold the right to work on a stage of a subject during a block; see `leases.held`.

        Parameters
        ----------
        stage, subject : str
            What is worked on, such as "localise" and a burst id.
        run_id : str
            Run that works on it.
        duration_s : float
            Time after which a run that does not renew it counts as dead, s; a thread renews it during the block.

        Returns
        -------
        context manager of Lease
            Raises BusyError on entry where a live run holds the lease.
        """
        return leases.held(self._engine, stage, subject, run_id, duration_s)

    def stage_runs(self, limit: int = 50) -> tuple[StageRun, ...]:
        """Last runs of all stages, the latest first; see `leases.stage_runs`."""
        return leases.stage_runs(self._engine, limit)

    def held_subjects(self) -> frozenset[str]:
        """What live runs work on, such as burst ids and days; see `leases.held_subjects`."""
        return leases.held_subjects(self._engine)

    def find_solution(self, burst_id: str, series: Series, inputs_hash: str, code_version: str) -> Solution | None:
        """The newest version of a series if it has these inputs and this code; see `publication.find_solution`."""
        return publication.find_solution(self._engine, burst_id, series, inputs_hash, code_version)

    def publish(
        self, new: Publication, lease: leases.Lease | None = None, check: Callable[[], None] = lambda: None
    ) -> Solution:
        """Make a solution visible as the next version of its series; see `publication.publish`.

        Parameters
        ----------
        new : Publication
            The solution and all that belongs to it; its group must be in the store already.
        lease : Lease, optional
            Right to work on the burst; where it is lost nothing is published.
        check : callable, optional
            Called last in the transaction; what it raises undoes all of it.

        Returns
        -------
        Solution
            The new version; or, with nothing written, the newest one where it has the same inputs and code.

        Raises
        ------
        InputError
            Where a name cannot be part of a solution id, or the localisations are not one per frequency.
        """
        return publication.publish(self._engine, new, lease, check)

    def add_companions(
        self, solution_id: str, companions: dict[str, Any], lease: leases.Lease | None = None
    ) -> dict[str, Any]:
        """Add once what other methods say of the track of a solution; see `publication.add_companions`."""
        return publication.add_companions(self._engine, solution_id, companions, lease)

    def bursts(self, query: BurstQuery | None = None) -> BurstPage:
        """One page of bursts; see `queries.bursts`.

        Raises
        ------
        InputError
            Where the cursor or the limit is not valid.
        """
        return queries.bursts(self._engine, query or BurstQuery(), self._summaries)

    def points(self, query: BurstQuery) -> PointPage:
        """Bursts as figures of many show them; see `queries.points`."""
        return queries.points(self._engine, query)

    def state_of(self, query: BurstQuery) -> str:
        """Digest of all that a query finds; see :func:`bella.catalogue.queries.state_of`."""
        return queries.state_of(self._engine, query)

    def changed_utc(self, what: queries.Changed) -> datetime | None:
        """When any of all of these was changed last; see :func:`bella.catalogue.queries.changed_utc`."""
        return queries.changed_utc(self._engine, what)

    def held(self) -> Held:
        """How much of real data there is; see `queries.held`."""
        return queries.held(self._engine)

    def burst(self, burst_id: str) -> BurstSummary:
        """One burst with the newest version of each series; NoDataError where there is none of that id."""
        return queries.burst(self._engine, burst_id, self._summaries)

    def versions(self, burst_id: str) -> tuple[Solution, ...]:
        """All solutions of a burst, superseded ones too, newer before older; NoDataError where there is no burst."""
        return queries.versions(self._engine, burst_id)

    def solutions(self, query: SolutionQuery) -> SolutionPage:
        """One page of solutions by the time of their publication; see `solutions.solutions`."""
        return solutions.solutions(self._engine, query)

    def all_sources(self, query: SourceQuery) -> SourcePage:
        """One page of the inputs of all solutions; see `solutions.all_sources`."""
        return solutions.all_sources(self._engine, query)

    def solution(self, solution_id: str) -> Solution:
        """One solution; NoDataError where there is none of that id."""
        return solutions.solution(self._engine, solution_id)

    def localisations(self, solution_id: str) -> tuple[Localisation, ...]:
        """Localisations of a solution by ascending frequency; NoDataError where there is no such solution."""
        return solutions.localisations(self._engine, solution_id)

    def localisations_of(self, solution_ids: Collection[str]) -> dict[str, list[Localisation]]:
        """Localisations of many solutions, each by ascending frequency; see `solutions.localisations_of`."""
        return solutions.localisations_of(self._engine, solution_ids)

    def places_of(self, solution_ids: Collection[str]) -> dict[str, list[tuple[float, float]]]:
        """Positions in the ecliptic plane of many solutions, by ascending frequency; see `solutions.places_of`."""
        return solutions.places_of(self._engine, solution_ids)

    def joints_of(self, some: Iterable[Solution]) -> dict[str, JointTrack]:
        """Joint fits of those of many solutions that have one; see `solutions.joints_of`."""
        return solutions.joints_of(self._engine, some, self._joints)

    def track(self, solution_id: str) -> Track | None:
        """Track of a solution, typed; None where it has no joint fit, NoDataError where there is no such solution."""
        return solutions.track(self._engine, solution_id)

    def track_fit(self, solution_id: str) -> dict[str, Any]:
        """Track of a solution as the JSON that is published; NoDataError where there is no such solution."""
        return solutions.track_fit(self._engine, solution_id)

    def prefer(self, burst_id: str, name: str, reason: str = "") -> Solution:
        """Pin the preferred series of a burst, whatever is published later; see `preference.prefer`.

        Raises
        ------
        NoDataError
            Where there is no such burst, or the burst has no such series.
        InputError
            Where the name leaves several series, or is that of a solution that has been superseded.
        """
        return preference.prefer(self._engine, burst_id, name, reason)

    def prefer_by_rule(self, burst_id: str) -> Solution:
        """Let the rule choose the preferred series of a burst again; NoDataError where there is no such burst."""
        return preference.prefer_by_rule(self._engine, burst_id)

    def sources(self, solution_id: str) -> tuple[SourceFile, ...]:
        """Inputs of a solution; NoDataError where there is no such solution."""
        return solutions.sources(self._engine, solution_id)

    def referenced_paths(self) -> frozenset[str]:
        """Store paths the catalogue refers to, which a sweep of the store must spare."""
        return solutions.referenced_paths(self._engine)

    def stored_groups(self) -> tuple[StoredGroup, ...]:
        """Every group of the store the catalogue refers to, with its checksum; see `solutions.stored_groups`."""
        return solutions.stored_groups(self._engine)

    def record_day(self, day: SearchedDay, found: Sequence[Detection], lease: leases.Lease | None = None) -> None:
        """Replace what is known of a searched day, in one commit; see `days.record_day`."""
        days.record_day(self._engine, day, found, lease)

    def record_unsearched(self, day: SearchedDay) -> None:
        """Keep why a day was not searched, unless it was before; see `days.record_unsearched`."""
        days.record_unsearched(self._engine, day)

    def searched_day(self, day: date, origins: Sequence[Origin] = REAL_ORIGINS) -> SearchedDay | None:
        """What a day was searched in, in data of the first of these origins; None where it was not."""
        return days.searched_day(self._engine, day, origins)

    def days(
        self,
        first: date | None = None,
        last: date | None = None,
        limit: int = 31,
        origins: Collection[Origin] = REAL_ORIGINS,
        cursor: str | None = None,
    ) -> DayPage:
        """Searched days of [first, last], the newest first, with what was detected on each; see `days.days`."""
        return days.days(self._engine, first, last, limit, origins, cursor)

    def days_beside(self, day: date, origins: Collection[Origin] = REAL_ORIGINS) -> tuple[date | None, date | None]:
        """Searched days before and after a day; see `days.neighbours`."""
        return days.neighbours(self._engine, day, origins)

    def detections_of(self, day: date, origins: Collection[Origin] = REAL_ORIGINS) -> tuple[Detection, ...]:
        """Detections recorded with a day, by onset; see `days.detections_of`."""
        return days.detections_of(self._engine, day, origins)

    def detections(self, query: DetectionQuery) -> DetectionPage:
        """One page of detections by onset; see `days.detections`."""
        return days.detections(self._engine, query)

    def retract(self, name: str, reason: str) -> str:
        """Retract a burst or a solution, and say of which burst; see `retraction.retract`."""
        return retraction.retract(self._engine, name, reason)

    def prunable(self, before_utc: datetime) -> tuple[Solution, ...]:
        """Solutions that were superseded before a time and have their draws; see `retraction.prunable`."""
        return retraction.prunable(self._engine, before_utc)

    def note_pruned(self, solution_id: str, store_path: str, store_sha256: str) -> None:
        """Let a superseded solution point to its group without draws; see `retraction.note_pruned`."""
        retraction.note_pruned(self._engine, solution_id, store_path, store_sha256)

    def note_packed(self, folder: str, store_path: str) -> None:
        """Let all that refers to the folder of a group refer to its file; see `retraction.note_packed`."""
        retraction.note_packed(self._engine, folder, store_path)

    def create_token(self, name: str) -> tuple[Token, str]:
        """Make a token, and the secret that is shown once; see `tokens.create`."""
        return tokens.create(self._engine, name)

    def tokens(self) -> tuple[Token, ...]:
        """All tokens, revoked ones too."""
        return tokens.tokens(self._engine)

    def token_of(self, secret: str) -> Token | None:
        """Token of a secret, a revoked one too; None where there is none."""
        return tokens.find(self._engine, secret)

    def revoke_token(self, token_id: str) -> Token:
        """Let a token open nothing any more; NoDataError where there is no such token."""
        return tokens.revoke(self._engine, token_id)

    def alerts(
        self,
        after: int = 0,
        limit: int = 100,
        origins: Collection[Origin] = ANNOUNCED_ORIGINS,
        burst_id: str | None = None,
    ) -> tuple[Alert, ...]:
        """Alerts after one of a sequence number, in the order of their commits; see `alerts.alerts`."""
        return alerts.alerts(self._engine, after, limit, origins, burst_id)

    def newest_alerts(self, limit: int, origins: Collection[Origin] = ANNOUNCED_ORIGINS) -> tuple[Alert, ...]:
        """The last alerts, the newest first."""
        return alerts.newest(self._engine, limit, origins)

    def last_alert(self) -> int:
        """Sequence number of the newest alert of any origin; 0 where there is none."""
        return alerts.last_sequence(self._engine)

    def add_webhook(self, url: str, *, with_tests: bool = False) -> Webhook:
        """Add a receiver of the alerts from now on."""
        return webhooks.add(self._engine, url, with_tests=with_tests)

    def webhooks(self) -> tuple[Webhook, ...]:
        """Receivers of alerts, and how much waits for each."""
        return webhooks.webhooks(self._engine)

    def remove_webhook(self, webhook_id: str) -> Webhook:
        """Send a receiver no more alerts; NoDataError where there is no such receiver."""
        return webhooks.remove(self._engine, webhook_id)

    def due_deliveries(self, webhook_id: str, now: datetime, limit: int) -> tuple[Delivery, ...]:
        """Alerts that may be sent to a receiver now, of each burst the first that waits; see `webhooks.due`."""
        return webhooks.due(self._engine, webhook_id, now, limit)

    def note_delivered(self, webhook_id: str, sequence: int) -> None:
        """Note that a receiver took an alert, or that it is given up."""
        webhooks.note_taken(self._engine, webhook_id, sequence)

    def note_refused(self, webhook_id: str, sequence: int, message: str, again_utc: datetime) -> None:
        """Note that a receiver refused one alert."""
        webhooks.note_refused(self._engine, webhook_id, sequence, message, again_utc)

    def note_away(self, webhook_id: str, message: str, again_utc: datetime) -> None:
        """Note that a receiver does not answer."""
        webhooks.note_away(self._engine, webhook_id, message, again_utc)

    def submit(self, token_id: str, sha256: str, submission_id: str) -> Submission:
        """Note that an arrival table was submitted; see `submissions.submit`."""
        return submissions.submit(self._engine, token_id, sha256, submission_id)

    def submission(self, submission_id: str) -> Submission:
        """One submission; NoDataError where there is none of that id."""
        return submissions.submission(self._engine, submission_id)

    def withdraw(self, submission_id: str) -> Submission:
        """Withdraw a submission and retract its burst; see `submissions.withdraw`."""
        return submissions.withdraw(self._engine, submission_id)

    def pending_submissions(self) -> tuple[Submission, ...]:
        """Submissions that wait for a run, in the order they came."""
        return submissions.pending(self._engine)

    def mark_submission(
        self, submission_id: str, state: str, message: str = "", burst_id: str | None = None
    ) -> Submission:
        """Note how a submission ended; see `submissions.mark`."""
        return submissions.mark(self._engine, submission_id, state, message, burst_id)
