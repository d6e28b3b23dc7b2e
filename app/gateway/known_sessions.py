"""Known sessions of a gateway, by their links: in memory, and on disk where there is a store."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Collection, Coroutine, Iterator

from app.access.session_messages import KeptFolder
from app.gateway.session import Session
from app.gateway.session_store import MOST_STORED, SessionStore, StoredSession
from app.gateway.visitors import Visitor
from app.process.redaction import new_secret

MOST_UNKEPT = 2000  # sessions without a folder


class KnownSessions:
    """Known sessions of a pool, also those that an earlier pool has left.

    store: where sessions are kept beyond the life of the pool, None for nowhere.
    background: starts a task for which nobody waits.
    now: s of the pool's clock.
    """

    def __init__(
        self, store: SessionStore | None, background: Callable[[Coroutine[None, None, object]], object], now: float
    ) -> None:
        self._store, self._background = store, background
        self._by_name: dict[str, Session] = {}
        self._by_watch: dict[str, Session] = {}
        self._noting = asyncio.Lock()  # one at a time: the links on disk are those noted last
        for left in store.known() if store is not None else ():
            session = Session(
                scenario=left.scenario,
                name=left.name,
                watch=left.watch,
                pinned=left.pinned,
                folder=left.folder,
                owner=Visitor(left.owner),
            )
            session.kept = session.looked_at = True
            session.seen = now
            self.add(session)

    def __iter__(self) -> Iterator[Session]:
        return iter(self._by_name.values())

    @property
    def on_disk(self) -> bool:
        """Whether there is a store."""
        return self._store is not None

    def named(self, name: str) -> Session | None:
        """Session with this link to steer."""
        return self._by_name.get(name)

    def watched(self, name: str) -> Session | None:
        """Session with this link to watch."""
        return self._by_watch.get(name)

    def add(self, session: Session) -> Session:
        """Know this session from now on, by its links."""
        self._by_name[session.name] = self._by_watch[session.watch] = session
        return session

    async def folder(self, session: Session) -> KeptFolder | None:
        """Folder of this session, made if need be; None without a store."""
        if self._store is None:
            return None
        async with self._noting:
            folder = await asyncio.to_thread(self._store.entered, _stored(session))
        return KeptFolder(str(folder), "offered" if session.offers else "shown")

    async def renew(self, session: Session) -> bool:
        """Give a session new links; returns whether it has them, since it may have been forgotten meanwhile. Raises
        OSError where they cannot be kept on disk: then the links stay as they were, because the old ones would open
        the session again after the next start."""
        async with self._noting:
            name, watch = new_secret(16), new_secret(16)
            if self._store is not None and session.kept:
                await asyncio.to_thread(self._store.enter, _stored(session)._replace(name=name, watch=watch))
            if self._by_name.pop(session.name, None) is None:  # forgotten meanwhile, maybe before it was entered
                if self._store is not None and session.kept:
                    await asyncio.to_thread(self._store.forget, session.folder)
                return False
            del self._by_watch[session.watch]
            session.name, session.watch = name, watch
            self.add(session)
            return True

    def make_room(self, session: Session, *, kept: bool, waiting: Collection[Session], now: float) -> bool:
        """Make room for this session among those that have a folder, or among those that have none; returns whether
        there is any. If need be, a session of no higher rank that rests and is not `waiting` is forgotten: of those
        of the lowest rank, one of the owner who has most, and of these the one not seen for longest.

        now: s of the pool's clock.
        """
        others = [other for other in self if other is not session and other.kept == kept]
        if len(others) < (MOST_STORED if kept else MOST_UNKEPT):
            return True
        stays = set(waiting)
        resting = [o for o in others if o.life is None and o not in stays and o.rank(now) <= session.rank(now)]
        if not resting:
            return False
        count = Counter(other.owner.address or other.owner.browser for other in others)
        self._forget(min(resting, key=lambda o: (o.rank(now), -count[o.owner.address or o.owner.browser], o.seen)))
        return True

    def _forget(self, session: Session) -> None:
        del self._by_name[session.name], self._by_watch[session.watch]
        if self._store is not None and session.kept:
            self._background(self._forget_on_disk(self._store, session.folder))

    async def _forget_on_disk(self, store: SessionStore, folder: str) -> None:
        async with self._noting:  # else links that are being noted would make the folder anew
            await asyncio.to_thread(store.forget, folder)


def _stored(session: Session) -> StoredSession:
    """Record of this session on disk."""
    owner = session.owner.browser
    return StoredSession(session.name, session.watch, session.scenario, session.pinned, owner, session.folder)
