"""Operations that routes and explorer share."""
